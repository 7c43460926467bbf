// What of the cells a request asks for, and where. Private to the library.
#pragma once

#include "client/map_client.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/grid.h"

namespace gem::client {

template <typename Request>
void SelectCells(const CellSelection& selection, Request& request) {
  for (const Layer layer : selection.layers)
    request.add_layers(static_cast<v1::Layer>(wire::ToProto(layer)));
  request.set_encoding(selection.encoding == CellEncoding::kRaw ? v1::CELL_ENCODING_RAW
                                                                : v1::CELL_ENCODING_COMPACT);
}

inline void RegionToProto(const Region& region, v1::Region* proto) {
  proto->set_x_min(region.x_m_min);
  proto->set_y_min(region.y_m_min);
  proto->set_x_max(region.x_m_max);
  proto->set_y_max(region.y_m_max);
}

}  // namespace gem::client
