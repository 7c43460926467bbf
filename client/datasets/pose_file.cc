#include "client/datasets/pose_file.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"
#include "core/grid/cell_index.h"

namespace gem {
namespace {

// Files with six digits are off by 1e-6; more than this is another matrix, or another format.
constexpr double kOrthonormalTolerance = 1e-3;
constexpr double kTimeMax_s = 9e9;  // int64 nanoseconds end at 9.2e9 s

std::string Where(const std::string& path, std::size_t line) {
  return absl::StrCat(path, ":", line);
}

}  // namespace

absl::StatusOr<RigidTransform> ParsePose(const std::string& where, const double* numbers) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(numbers);
  const Eigen::Matrix3d rotation = matrix.leftCols<3>();
  const double error =
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  // Written so that NaN fails too.
  if (!(error <= kOrthonormalTolerance))
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": the rotation is not orthonormal: R * R^T differs from identity by ",
                     error, ", want at most ", kOrthonormalTolerance));
  if (rotation.determinant() < 0)
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": the rotation is a reflection: its determinant is ",
                     rotation.determinant(), ", want 1"));
  const Eigen::Vector3d translation = matrix.col(3);
  const double distance_m = translation.cwiseAbs().maxCoeff();
  if (!(distance_m <= kCoordinateMax_m))
    return absl::InvalidArgumentError(absl::StrCat(where, ": the translation holds ", distance_m,
                                                   " m, want at most ", kCoordinateMax_m));
  return RigidTransform{Eigen::Quaterniond(rotation).normalized(), translation};
}

absl::StatusOr<PoseFile> ReadPoseFile(const std::string& path) {
  GEM_ASSIGN_OR_RETURN(NumberTable table, ReadNumberTable(path, 12));
  PoseFile file{path, {}, {}};
  file.poses.reserve(table.num_rows());
  for (std::size_t row = 0; row < table.num_rows(); ++row) {
    GEM_ASSIGN_OR_RETURN(const RigidTransform pose,
                         ParsePose(Where(path, table.lines[row]), table.row(row)));
    file.poses.push_back(pose);
  }
  file.lines = std::move(table.lines);
  return file;
}

absl::StatusOr<TimesFile> ReadTimesFile(const std::string& path) {
  GEM_ASSIGN_OR_RETURN(NumberTable table, ReadNumberTable(path, 1));
  TimesFile file{path, {}, {}};
  file.stamps_ns.reserve(table.num_rows());
  for (std::size_t row = 0; row < table.num_rows(); ++row) {
    const double time_s = table.values[row];
    if (std::abs(time_s) > kTimeMax_s)
      return absl::InvalidArgumentError(absl::StrCat(Where(path, table.lines[row]), ": time is ",
                                                     time_s, " s, want at most ", kTimeMax_s));
    const std::int64_t stamp_ns = std::llround(time_s * 1e9);
    if (row > 0 && stamp_ns <= file.stamps_ns.back())
      return absl::InvalidArgumentError(absl::StrCat(
          Where(path, table.lines[row]), ": time ", time_s, " s does not follow ",
          table.values[row - 1], " s of line ", table.lines[row - 1], ", want increasing times"));
    file.stamps_ns.push_back(stamp_ns);
  }
  file.lines = std::move(table.lines);
  return file;
}

absl::Status CheckSameCount(const PoseFile& poses, const TimesFile& times) {
  if (poses.poses.size() == times.stamps_ns.size()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(poses.path, " has ", poses.poses.size(),
                                                 " poses, but ", times.path, " has ",
                                                 times.stamps_ns.size(), " times"));
}

}  // namespace gem
