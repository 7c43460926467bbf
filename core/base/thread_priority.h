// Which threads may wait when cores are short.
#pragma once

namespace gem {

/// From here on the calling thread, and every thread that it starts, gives way to the others of the
/// process: it gets about a tenth of a core that they want, too. Whether one that wakes up gets its
/// core at once is up to the scheduler. It cannot be undone.
void RunBehindOthers();

}  // namespace gem
