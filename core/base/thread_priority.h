// Which threads may wait when cores are short.
#pragma once

namespace gem {

/// From here on the calling thread, and every thread that it starts, gives way to the others of the
/// process: they are scheduled before it at once, and it gets about a tenth of a core that they do
/// not leave it. It cannot be undone.
void RunBehindOthers();

}  // namespace gem
