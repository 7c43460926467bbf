// The oracle of the local mapper: slow and obvious. Cells lie in plain rows that are copied when
// the window moves, planes are fitted by QR, and every ray is held against every obstacle cell.
#pragma once

#include <memory>

#include "core/local/local_mapper.h"

namespace gem {

/// The options are valid.
std::unique_ptr<LocalMapper> MakeReferenceMapper(const LocalMapOptions& options);

}  // namespace gem
