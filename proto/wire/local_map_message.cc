#include "proto/wire/local_map_message.h"

#include <utility>

#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"

namespace gem::wire {
namespace {

SplicedMessage LocalMapMessage(const LocalMap& map, const LocalMapContext& context,
                               const std::shared_ptr<const EncodedCells>& grid) {
  v1::LocalMap head;
  HeadToProto(map, context, &head);
  SplicedMessage message;
  message.Append(head.SerializeAsString());
  message.AppendShared(v1::LocalMap::kGridFieldNumber, {grid, &grid->bytes});
  return message;
}

}  // namespace

EncodedCells EncodeGrid(const LocalMap& map, std::span<const Layer> layers, CellEncoding encoding) {
  v1::Grid grid;
  ToProto(GridOf(map, layers), encoding, &grid);
  return {grid.SerializeAsString(), 0};
}

SplicedMessage GetLocalMapMessage(const LocalMap& map, const LocalMapContext& context,
                                  const std::shared_ptr<const EncodedCells>& grid) {
  SplicedMessage message;
  message.AppendMessage(v1::GetLocalMapResponse::kLocalMapFieldNumber,
                        LocalMapMessage(map, context, grid));
  return message;
}

SplicedMessage WatchLocalMapMessage(const LocalMap& map, const LocalMapContext& context,
                                    const std::shared_ptr<const EncodedCells>& grid,
                                    std::uint64_t num_skipped) {
  SplicedMessage message;
  message.AppendMessage(v1::WatchLocalMapResponse::kLocalMapFieldNumber,
                        LocalMapMessage(map, context, grid));
  v1::WatchLocalMapResponse rest;
  rest.set_num_skipped(num_skipped);
  message.Append(rest.SerializeAsString());
  return message;
}

}  // namespace gem::wire
