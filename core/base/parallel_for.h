// Runs independent pieces of work on a few threads and returns when all are done.
#pragma once

#include <cstddef>
#include <functional>

namespace gem {

/// Calls work(i) once for each i in [0, count), on the calling thread and up to threads - 1 others.
/// The order is unspecified: the result must not depend on it. work must not throw.
void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& work);

}  // namespace gem
