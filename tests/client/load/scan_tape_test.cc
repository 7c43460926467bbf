#include "client/load/scan_tape.h"

#include <gmock/gmock.h>
#include <grpcpp/support/proto_buffer_reader.h>
#include <gtest/gtest.h>

#include "client/load/serving_bench.h"
#include "gem/v1/ingest_service.pb.h"
#include "proto/wire/scan.h"
#include "tests/client/load/growing_source.h"

namespace gem::load {
namespace {

std::unique_ptr<const ScanTape> TapeOf(std::size_t num_scans) {
  GrowingSource source(num_scans);
  auto tape = ScanTape::Record(source, {}, 100);
  EXPECT_TRUE(tape.ok()) << tape.status();
  return *std::move(tape);
}

v1::IngestRequest Parsed(grpc::ByteBuffer buffer) {
  v1::IngestRequest request;
  grpc::ProtoBufferReader reader(&buffer);
  EXPECT_TRUE(request.ParseFromZeroCopyStream(&reader));
  return request;
}

client::IngestOptions Int16() {
  client::IngestOptions options;
  options.point_encoding = client::PointEncoding::kInt16;
  return options;
}

TEST(ScanTape, PutsMessagesTogetherThatParse) {
  const auto tape = TapeOf(3);
  const v1::IngestRequest request = Parsed(tape->Message(2));
  ASSERT_TRUE(request.has_scan());
  const v1::Scan& scan = request.scan();
  EXPECT_EQ(scan.seq(), 2u);
  EXPECT_EQ(scan.stamp_ns(), 200'000'000);
  EXPECT_EQ(scan.odom_from_base().x(), 2);
  EXPECT_EQ(tape->PayloadBytes(2), wire::PayloadBytes(scan));
  wire::DecodedScan decoded;
  ASSERT_TRUE(wire::FromProto(scan, {}, wire::FieldPath("scan"), decoded).ok());
  ASSERT_EQ(decoded.points.size(), 2u);
  EXPECT_EQ(decoded.points[1].z_m, 3);
}

TEST(ScanTape, PlaysForwardsAndBackwardsWithoutAJump) {
  const auto tape = TapeOf(3);
  std::vector<double> x_m;
  for (std::uint64_t seq = 1; seq <= 9; ++seq)
    x_m.push_back(Parsed(tape->Message(seq)).scan().odom_from_base().x());
  EXPECT_THAT(x_m, testing::ElementsAre(1, 2, 3, 2, 1, 2, 3, 2, 1));
}

TEST(ScanTape, LeavesOutThePosesIfAsked) {
  const auto tape = TapeOf(3);
  const v1::IngestRequest with = Parsed(tape->Message(2));
  const v1::IngestRequest without = Parsed(tape->WithoutPoses()->Message(2));
  EXPECT_FALSE(without.scan().has_odom_from_base());
  EXPECT_EQ(without.scan().points(), with.scan().points());
  EXPECT_EQ(without.scan().seq(), 2u);
}

TEST(ScanTape, OfOneScanRepeatsIt) {
  const auto tape = TapeOf(1);
  EXPECT_EQ(Parsed(tape->Message(1)).scan().odom_from_base().x(), 1);
  EXPECT_EQ(Parsed(tape->Message(7)).scan().odom_from_base().x(), 1);
}

TEST(ScanTape, TakesNoMoreScansThanItMayAndWantsOne) {
  GrowingSource many(10);
  const auto tape = ScanTape::Record(many, Int16(), 4);
  ASSERT_TRUE(tape.ok());
  EXPECT_EQ((*tape)->num_scans(), 4u);
  EXPECT_EQ((*tape)->mean_points(), 2.5);
  GrowingSource none(0);
  EXPECT_EQ(ScanTape::Record(none, Int16(), 4).status().message(), "growing has no scan");
}

TEST(Milliseconds, AreNearestRanks) {
  std::vector<double> seconds;
  for (int i = 100; i >= 1; --i) seconds.push_back(i * 1e-3);
  const Milliseconds ms = MillisecondsOf(seconds);
  EXPECT_NEAR(ms.p50, 50, 1e-9);
  EXPECT_NEAR(ms.p99, 99, 1e-9);
  EXPECT_NEAR(ms.max, 100, 1e-9);
  EXPECT_EQ(MillisecondsOf({}).p99, 0);
}

}  // namespace
}  // namespace gem::load
