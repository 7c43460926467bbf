// The embedded default of the local mapper: linear passes over the points and the cells of a ring
// buffer, without allocation once buffers have grown.
#pragma once

#include <memory>

#include "core/base/vector_set.h"
#include "core/local/local_mapper.h"

namespace gem {

/// The options are valid.
std::unique_ptr<LocalMapper> MakeCpuMapper(const LocalMapOptions& options, int threads,
                                           VectorSet set = WidestVectorSet());

}  // namespace gem
