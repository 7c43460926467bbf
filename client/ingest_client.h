// Streams the scans of one session to a server: waits for credit, keeps what the server has not
// fused, and after a broken stream opens the session again and sends what is missing.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/connection.h"
#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"
#include "core/grid/map_version.h"
#include "core/sensor/depth_image.h"
#include "core/sensor/noise_model.h"
#include "core/sensor/scan.h"

namespace gem::client {

/// A sensor, where it is mounted and how it errs.
struct SensorSetup {
  std::string name;
  Pose<Base, Sensor> T_B_S;
  NoiseModel noise;
};

/// Axis-aligned box in B, metres.
struct Box {
  Eigen::Vector3f min = Eigen::Vector3f::Zero();
  Eigen::Vector3f max = Eigen::Vector3f::Zero();
};

/// What a session is made of. What is unset takes the server's default.
struct SessionSetup {
  std::string map;      ///< created if it does not exist
  std::string robot;    ///< id
  std::string session;  ///< id, unique within the map; the same id resumes
  Pose<Global, Odom> T_G_O;
  std::vector<SensorSetup> sensors;

  // The local map.
  std::optional<float> side_m;
  std::optional<float> range_m_min;
  std::optional<float> range_m_max;
  std::optional<float> height_m_min;  ///< over B
  std::optional<float> height_m_max;  ///< over B
  std::optional<Box> body;            ///< points inside are the robot itself

  // The map, if this session creates it; else it must agree.
  std::optional<float> cell_size_m;
  std::optional<float> submap_length_m;
  bool traversable_only = false;
};

/// Covariance of a pose.
struct PoseCovariance {
  Eigen::Matrix3d translation_m2 = Eigen::Matrix3d::Zero();  ///< in O
  Eigen::Matrix3d rotation_rad2 = Eigen::Matrix3d::Zero();   ///< of the rotation vector, in B
};

/// One scan to send: points, which must be finite, or a depth image. Somebody else holds them.
struct OutgoingScan {
  std::int64_t stamp_ns = 0;  ///< newer than the last scan's
  std::string sensor;
  /// Nothing: the server takes it from streamed poses, for which the scan waits a while.
  std::optional<Pose<Odom, Base>> T_O_B;
  std::optional<PoseCovariance> covariance;
  std::span<const ScanPoint> points;
  /// When each point was measured, seconds relative to stamp_ns; at most 1 in magnitude. Points are
  /// then in S of their own time, and the server carries them to S of the stamp with the streamed
  /// poses. Empty: all points are in S of the stamp.
  std::span<const float> time_offsets_s = {};
  std::optional<DepthImage> depth_image = {};  ///< instead of points
};

/// How points travel.
enum class PointEncoding {
  kFloat32,  ///< exact; 12 bytes a point, 16 with colour
  kInt16,    ///< 6 bytes a point, 10 with colour; in steps of int16_step_m, or more far away
};

/// How the bytes of points and pixels are compressed, without loss.
enum class ScanCompression {
  kNone,
  kZstd,       ///< for what is no LiDAR sweep
  kDeltaZstd,  ///< points: differences between neighbours first; pixels: like kZstd
};

/// What the server refused. A refused scan does not end the session.
struct IngestProblem {
  std::uint64_t seq = 0;  ///< 0: a batch of poses, or several scans
  std::string reason;     ///< for programs: "malformed", "out_of_order", ...
  std::string message;    ///< for people: the field, its value, the limit
};

/// What gives way when scans come faster than they can be sent or fused.
enum class OverloadPolicy {
  /// Nothing: Send() and SendPoses() wait. For recordings.
  kBlock,
  /// Send() and SendPoses() never wait. Here the oldest scan that is not yet on its way gives way
  /// to the newest, at the server the oldest that waits. For live robots.
  kDropOldest,
};

/// What is kept of what was given to Send() and SendPoses() is bounded in bytes and, as long as it
/// is not on its way, in number. At either limit the calls wait, or the oldest unsent scans are
/// dropped and counted in IngestProgress, as `overload` says. What is on its way is kept until the
/// server has fused it. When a stream breaks, what the server had not accepted is unsent again.
struct IngestOptions {
  /// To reach the server and open the session, seconds. Range [0.001, 3600].
  double open_timeout_s = 10;
  /// Without an answer of the server while one is due, seconds. Range [0.001, 1e6].
  double progress_timeout_s = 120;
  /// Streams that are tried one after the other without getting a scan accepted. Range [1, 1000].
  int tries_max = 10;
  /// First wait between two tries, seconds; doubles each time. Range [0, backoff_s_max].
  double backoff_s_min = 0.1;
  double backoff_s_max = 5;  ///< range [0, 3600]
  /// Scans and poses that are kept until they are fused, bytes. One scan always fits, however
  /// large. Range [1, 2^40].
  std::uint64_t buffer_bytes_max = std::uint64_t{256} << 20;
  /// Scans that wait to be written. With kDropOldest this is how long a silence of the radio link
  /// may be without a scan being lost: a second of a 10 Hz LiDAR. Range [1, 100000].
  int unsent_scans_max = 10;
  OverloadPolicy overload = OverloadPolicy::kBlock;
  PointEncoding point_encoding = PointEncoding::kFloat32;
  /// How finely kInt16 keeps coordinates, metres. A scan that reaches farther than 32767 steps
  /// takes coarser ones: at 1 mm beyond 32 m, at 4 mm beyond 131 m. Range [1e-5, 1].
  double int16_step_m = 1e-3;
  ScanCompression compression = ScanCompression::kNone;
  /// Called for everything the server refuses, from a thread of the library; must not call back
  /// into the client.
  std::function<void(const IngestProblem&)> on_problem;
};

/// INVALID_ARGUMENT: "tries_max is 0, want [1, 1000]".
absl::Status Validate(const IngestOptions& options);

/// The server's answer to opening.
struct SessionOpened {
  std::uint64_t resume_after_seq = 0;  ///< scans that an earlier stream of this session delivered
  std::uint64_t scan_bytes_max = 0;
  double cell_size_m = 0;
  double local_map_side_m = 0;
};

struct IngestProgress {
  std::uint64_t sent_seq = 0;   ///< newest scan that was written to a stream
  std::uint64_t fused_seq = 0;  ///< all up to here are fused or refused
  std::uint64_t num_problems = 0;
  std::uint64_t num_reconnects = 0;
  /// Scans that were dropped before the server had accepted them. What the server dropped is among
  /// the problems, with reason "dropped".
  std::uint64_t num_dropped = 0;
};

/// The server's answer to Close().
struct SessionClosed {
  MapVersion version;  ///< maps of this version and later show everything the session sent
  std::uint64_t num_scans_fused = 0;
  std::uint64_t num_scans_refused = 0;
  /// Scans with time offsets that were fused as they were, because no streamed poses cover them.
  std::uint64_t num_scans_not_deskewed = 0;
  std::uint64_t num_scans_dropped = 0;  ///< by the server, for newer ones
};

/// One session. Send(), SendPoses(), WaitUntilFused() and Close() come from one thread; progress()
/// from any.
class IngestClient {
 public:
  /// Opens the session, or goes on with it. INVALID_ARGUMENT for an int16_step_m out of range.
  static absl::StatusOr<std::unique_ptr<IngestClient>> Open(
      std::shared_ptr<const Connection> connection, const SessionSetup& setup,
      IngestOptions options = {});
  /// Breaks the stream. The session goes on: open it again with its id.
  ~IngestClient();

  const SessionOpened& opened() const;

  /// Hands the scan to the stream, which numbers it; waits for room in the buffer, and so for
  /// credit, unless the overload policy is kDropOldest. INVALID_ARGUMENT: the scan is malformed,
  /// too large or does not fit its encoding, and is not sent. Other errors end the client:
  /// DEADLINE_EXCEEDED, DATA_LOSS (the server forgot the session), or why the server cannot be
  /// reached.
  absl::Status Send(const OutgoingScan& scan);
  /// Poses for scans that carry none and for points with time offsets; stamps increase. At most
  /// 4096. They overtake scans that wait for credit: scans at the server may be waiting for them.
  absl::Status SendPoses(const std::vector<StampedPose<Odom, Base>>& poses);

  /// Returns when every scan that was sent is fused or refused.
  absl::Status WaitUntilFused();

  /// Ends the session; returns when everything it sent is in the published map.
  absl::StatusOr<SessionClosed> Close();

  IngestProgress progress() const;

 private:
  class Impl;
  explicit IngestClient(std::unique_ptr<Impl> impl);
  const std::unique_ptr<Impl> impl_;
};

}  // namespace gem::client
