#include "tests/fuzz/decoders.h"

#include <google/protobuf/stubs/logging.h>

#include <cmath>
#include <memory>
#include <span>

#include "core/base/check.h"
#include "gem/v1/ingest_service.pb.h"
#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/map.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/session_setup.h"
#include "server/session_mapper.h"

namespace gem::fuzz {
namespace {

SessionConfig SmallSession() {
  SessionConfig config;
  config.setup = {"map", "robot", "session", {}, {}, {}, {}};
  config.setup.sensors.push_back({"top", {}, *MakeNoiseModel(LidarNoise())});
  config.local_map.side_m = 2;
  config.scan_limits = {.scan_bytes_max = 4096, .points_max = 256};
  return config;
}

void RunScan(const v1::Scan& scan) {
  SessionMapper mapper(SmallSession());
  SessionMapper::HeldScan held;
  const absl::Status taken = mapper.Take(std::make_shared<const v1::Scan>(scan), held);
  // A refusal names its field: robots show it to people.
  GEM_CHECK(taken.ok() || !wire::FieldOf(taken).empty());
  if (!taken.ok()) return;
  // Poses about the stamp, so that points with time offsets are deskewed.
  v1::PoseBatch poses;
  wire::ToProto({{0, {}}, {2'000'000'000, Pose<Odom, Base>::FromYaw(1, {1, 2, 3})}}, &poses);
  GEM_CHECK(mapper.AddPoses(poses).ok());
  const auto readiness = mapper.Prepare(held, "the fuzzer does not wait");
  GEM_CHECK(readiness.ok() || !wire::FieldOf(readiness.status()).empty());
  if (!readiness.ok()) return;
  GEM_CHECK(*readiness == SessionMapper::Readiness::kReady);
  const std::size_t num_points = held.scan.points.size() + held.scan.packed.count;
  const ScanReport report = mapper.Fuse(held);
  GEM_CHECK(report.points == num_points);
  const auto map = mapper.CopyLocalMap();
  for (std::size_t i = 0; i < map->num_cells(); ++i)
    GEM_CHECK(std::isfinite(map->elevation_m[i]) && std::isfinite(map->variance_m2[i]));
  GEM_CHECK(mapper.End().ended);
}

void CheckGrid(const LayeredGrid& grid) {
  for (const GridLayer& layer : grid.layers) {
    GEM_CHECK(layer.valid.size() == grid.num_cells());
    for (const float value : layer.values) GEM_CHECK(std::isfinite(value));
  }
}

}  // namespace

void IngestRequest(const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);  // it reports every broken string
  v1::IngestRequest request;
  if (!request.ParseFromArray(data, static_cast<int>(size))) return;
  if (request.has_open()) {
    const auto setup = wire::FromProto(request.open(), wire::FieldPath("open"));
    GEM_CHECK(setup.ok() || !wire::FieldOf(setup.status()).empty());
    if (setup.ok()) {
      // Whatever the options, judging them is safe.
      (void)Validate(setup->local_map.Over({}));
      (void)Validate(setup->map_setup.Over({}));
    }
  }
  if (request.has_poses()) {
    SessionMapper mapper(SmallSession());
    (void)mapper.AddPoses(request.poses());
  }
  if (request.has_scan()) RunScan(request.scan());
}

void Tile(const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);
  v1::Tile proto;
  if (!proto.ParseFromArray(data, static_cast<int>(size))) return;
  const auto tile = wire::FromProto(proto, wire::FieldPath("tile"));
  GEM_CHECK(tile.ok() || !wire::FieldOf(tile.status()).empty());
  if (!tile.ok() || !tile->grid.has_value()) return;
  CheckGrid(*tile->grid);
}

void LocalMap(const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);
  v1::LocalMap proto;
  if (!proto.ParseFromArray(data, static_cast<int>(size))) return;
  const auto map = wire::FromProto(proto, wire::FieldPath("local_map"));
  GEM_CHECK(map.ok() || !wire::FieldOf(map.status()).empty());
  if (map.ok()) CheckGrid(map->grid);
}

std::vector<std::string> IngestRequestSeeds() {
  std::vector<std::string> seeds;
  v1::IngestRequest request;
  wire::SessionSetup setup = SmallSession().setup;
  setup.local_map.side_m = 8.0f;
  setup.local_map.body = BodyBox{-1, -1, -1, 1, 1, 1};
  setup.map_setup.cell_size_m = 0.1f;
  wire::ToProto(setup, request.mutable_open());
  seeds.push_back(request.SerializeAsString());

  wire::ToProto({{1, {}}, {2, Pose<Odom, Base>::FromYaw(1, {1, 2, 3})}}, request.mutable_poses());
  seeds.push_back(request.SerializeAsString());

  v1::Scan* scan = request.mutable_scan();
  scan->set_seq(1);
  scan->set_stamp_ns(100);
  scan->set_sensor("top");
  wire::ToProto(Pose<Odom, Base>::FromTranslation(0, 0, 1), scan->mutable_odom_from_base());
  wire::CovarianceToProto({Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Identity()}, scan);
  const std::vector<ScanPoint> points = {
      {0.6f, 0.1f, -1, 0xff0000ff}, {-0.7f, 0.2f, -0.5f, 0}, {0.1f, 0.9f, -1, 0xff00ff00}};
  wire::PointsToProto(points, scan);
  seeds.push_back(request.SerializeAsString());
  for (const auto compression : {wire::ScanCompression::kNone, wire::ScanCompression::kZstd,
                                 wire::ScanCompression::kDeltaZstd}) {
    (void)wire::PointsToProtoInt16(points, 0.001, scan);
    wire::Compress(compression, scan);
    seeds.push_back(request.SerializeAsString());
  }
  scan->set_stamp_ns(1'000'000'000);
  wire::PointsToProto(points, scan, std::vector<float>{-0.5f, 0, 0.25f});
  seeds.push_back(request.SerializeAsString());
  scan->clear_odom_from_base();
  seeds.push_back(request.SerializeAsString());

  scan->Clear();
  scan->set_seq(1);
  scan->set_stamp_ns(100);
  scan->set_sensor("top");
  const std::vector<std::uint16_t> depths = {1000, 0, 2000, 65535};
  const std::vector<std::uint8_t> colors(12, 77);
  DepthImage image;
  image.width = image.height = 2;
  image.fx_px = image.fy_px = 2;
  image.cx_px = image.cy_px = 0.5;
  image.depth = std::as_bytes(std::span(depths));
  image.rgb = std::as_bytes(std::span(colors));
  wire::ToProto(image, scan->mutable_depth_image());
  seeds.push_back(request.SerializeAsString());
  wire::Compress(wire::ScanCompression::kZstd, scan);
  seeds.push_back(request.SerializeAsString());
  scan->clear_compression();
  const std::vector<float> depths_m = {1, 0, std::nanf(""), 1e30f};
  image.encoding = DepthEncoding::kFloat32;
  image.depth = std::as_bytes(std::span(depths_m));
  image.rgb = {};
  image.step = 2;
  wire::ToProto(image, scan->mutable_depth_image());
  seeds.push_back(request.SerializeAsString());

  request.mutable_close();
  seeds.push_back(request.SerializeAsString());
  return seeds;
}

std::vector<std::string> TileSeeds() {
  std::vector<std::string> seeds;
  gem::Tile tile{0, {-1, 2}, {3, 4}, std::vector<CellBelief>(kTileCells * kTileCells)};
  tile.cells[5] = {1.5f,       0.01f,         0.9f,
                   0xff102030, 1'000'000'000, kCellKnown | kCellAnnotated | kCellColored};
  v1::Tile proto;
  wire::ToProto(tile, 0.2f, wire::TileLayers(), wire::CellEncoding::kCompact, &proto);
  seeds.push_back(proto.SerializeAsString());
  proto.Clear();
  proto.set_absent(true);
  seeds.push_back(proto.SerializeAsString());
  return seeds;
}

std::vector<std::string> LocalMapSeeds() {
  SessionMapper mapper(SmallSession());
  const auto map = mapper.CopyLocalMap();
  std::vector<std::string> seeds;
  for (const auto encoding : {wire::CellEncoding::kRaw, wire::CellEncoding::kCompact}) {
    v1::LocalMap proto;
    wire::ToProto(*map, {{}, "session"}, wire::LocalMapLayers(), encoding, &proto);
    seeds.push_back(proto.SerializeAsString());
  }
  return seeds;
}

}  // namespace gem::fuzz
