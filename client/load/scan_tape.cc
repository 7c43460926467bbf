#include "client/load/scan_tape.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <array>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "client/ingest_messages.h"
#include "core/base/status_macros.h"
#include "gem/v1/ingest_service.pb.h"

namespace gem::load {
namespace {

constexpr char kSensor[] = "lidar";

using google::protobuf::io::CodedOutputStream;

/// Tag of a field that is preceded by its length.
std::uint32_t TagOf(int field) { return static_cast<std::uint32_t>(field) << 3 | 2; }

/// What stands before the points: the request's field, the scan without them, their field.
std::string HeadBytes(const v1::Scan& head, std::size_t payload_bytes) {
  const std::uint32_t points_tag = TagOf(v1::Scan::kPointsFieldNumber);
  const std::string fields = head.SerializeAsString();
  const std::size_t scan_bytes =
      fields.size() + payload_bytes + CodedOutputStream::VarintSize32(points_tag) +
      CodedOutputStream::VarintSize32(static_cast<std::uint32_t>(payload_bytes));
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    CodedOutputStream out(&stream);
    out.WriteTag(TagOf(v1::IngestRequest::kScanFieldNumber));
    out.WriteVarint32(static_cast<std::uint32_t>(scan_bytes));
    out.WriteString(fields);
    out.WriteTag(points_tag);
    out.WriteVarint32(static_cast<std::uint32_t>(payload_bytes));
  }
  return bytes;
}

}  // namespace

absl::StatusOr<std::unique_ptr<const ScanTape>> ScanTape::Record(
    ScanSource& source, const client::IngestOptions& options, std::size_t num_scans_max) {
  auto tape = std::make_unique<ScanTape>();
  tape->name_ = source.name();
  tape->sensors_ = {{kSensor, source.T_B_S(), source.noise()}};
  SourceScan scan;
  while (tape->scans_.size() < num_scans_max) {
    GEM_ASSIGN_OR_RETURN(const bool more, source.Next(scan));
    if (!more) break;
    Recorded& recorded = tape->scans_.emplace_back();
    GEM_RETURN_IF_ERROR(client::ToProto(
        {scan.stamp_ns, kSensor, scan.T_O_B, std::nullopt, scan.points}, options, &recorded.head));
    client::Compress(options.compression, &recorded.head);
    recorded.payload = std::move(*recorded.head.mutable_points());
    recorded.head.clear_points();
  }
  if (tape->scans_.empty())
    return absl::InvalidArgumentError(absl::StrCat(source.name(), " has no scan"));
  return tape;
}

std::unique_ptr<const ScanTape> ScanTape::WithoutPoses() const {
  auto tape = std::make_unique<ScanTape>(*this);
  for (Recorded& recorded : tape->scans_) recorded.head.clear_odom_from_base();
  return tape;
}

const ScanTape::Recorded& ScanTape::At(std::uint64_t seq) const {
  if (scans_.size() == 1) return scans_.front();
  // Both ends come once in a round.
  const std::size_t round = 2 * (scans_.size() - 1);
  const std::size_t at = (seq - 1) % round;
  return scans_[at < scans_.size() ? at : round - at];
}

grpc::ByteBuffer ScanTape::Message(std::uint64_t seq) const {
  const Recorded& recorded = At(seq);
  v1::Scan head = recorded.head;
  head.set_seq(seq);
  head.set_stamp_ns(static_cast<std::int64_t>(seq) * kScanPeriod_ns);
  const std::array<grpc::Slice, 2> slices = {
      grpc::Slice(HeadBytes(head, recorded.payload.size())),
      grpc::Slice(recorded.payload.data(), recorded.payload.size(), grpc::Slice::STATIC_SLICE)};
  return {slices.data(), slices.size()};
}

double ScanTape::mean_points() const {
  return std::accumulate(
             scans_.begin(), scans_.end(), 0.0,
             [](double sum, const Recorded& scan) { return sum + scan.head.point_count(); }) /
         static_cast<double>(scans_.size());
}

double ScanTape::mean_payload_bytes() const {
  return std::accumulate(scans_.begin(), scans_.end(), 0.0,
                         [](double sum, const Recorded& scan) {
                           return sum + static_cast<double>(scan.payload.size());
                         }) /
         static_cast<double>(scans_.size());
}

}  // namespace gem::load
