#include "client/datasets/kitti_layout.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kCalibrationBytesMax = 1 << 20;

absl::StatusOr<std::array<double, 12>> ParseNumbers(const std::string& where,
                                                    const std::string& key,
                                                    absl::string_view text) {
  std::array<double, 12> numbers{};
  std::size_t count = 0;
  for (const absl::string_view word :
       absl::StrSplit(text, absl::ByAnyChar(" \t\r"), absl::SkipEmpty())) {
    double value = 0;
    if (!ParseNumber(word, value) || !std::isfinite(value))
      return absl::InvalidArgumentError(absl::StrCat(
          where, ": ", key, " holds \"", word.substr(0, 32), "\", want finite numbers"));
    if (count < numbers.size()) numbers[count] = value;
    ++count;
  }
  if (count != numbers.size())
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": ", key, " has ", count, " numbers, want 12"));
  return numbers;
}

}  // namespace

absl::StatusOr<KittiPoseFrame> ParseKittiPoseFrame(const std::string& text) {
  if (text == "auto") return KittiPoseFrame::kAutomatic;
  if (text == "velodyne") return KittiPoseFrame::kVelodyne;
  if (text == "camera") return KittiPoseFrame::kCamera;
  return absl::InvalidArgumentError(
      absl::StrCat("pose_frame is \"", text, "\", want auto, velodyne or camera"));
}

std::string DirectoryName(const std::string& dir) {
  // "dir/" has no file name of its own.
  const fs::path path = fs::path(dir).lexically_normal();
  return path.has_filename() ? path.filename() : path.parent_path().filename();
}

std::string InDirectory(const std::string& dir, const std::string& path) {
  return (fs::path(dir) / path).string();
}

absl::StatusOr<std::vector<std::string>> ListFiles(const std::string& dir, absl::string_view begin,
                                                   absl::string_view end) {
  std::error_code error;
  std::vector<std::string> paths;
  fs::directory_iterator entry(dir, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (absl::StartsWith(name, begin) && absl::EndsWith(name, end))
      paths.push_back(entry->path().string());
  }
  if (error) return absl::NotFoundError(absl::StrCat(dir, ": ", error.message()));
  std::sort(paths.begin(), paths.end());
  return paths;
}

absl::StatusOr<std::string> FindPosesFile(const std::string& dir, const std::string& poses) {
  if (!poses.empty()) return InDirectory(dir, poses);
  std::error_code error;
  std::string usual = InDirectory(dir, "poses.txt");
  if (fs::exists(usual, error)) return usual;
  GEM_ASSIGN_OR_RETURN(const std::vector<std::string> paths, ListFiles(dir, "poses", ".txt"));
  if (paths.size() == 1) return paths.front();
  if (paths.empty())
    return absl::NotFoundError(absl::StrCat(dir, ": no poses.txt, name the poses file"));
  return absl::InvalidArgumentError(
      absl::StrCat(dir, ": no poses.txt, name one of ", absl::StrJoin(paths, ", ")));
}

absl::StatusOr<std::optional<std::array<double, 12>>> ReadCalibrationLine(const std::string& path,
                                                                          const std::string& key) {
  std::error_code error;
  if (!fs::exists(path, error)) return std::optional<std::array<double, 12>>();
  GEM_ASSIGN_OR_RETURN(const std::string contents, ReadFile(path, kCalibrationBytesMax));
  std::size_t line_number = 0;
  for (const absl::string_view line : absl::StrSplit(contents, '\n')) {
    ++line_number;
    if (!absl::StartsWith(line, key + ":")) continue;
    GEM_ASSIGN_OR_RETURN(const auto numbers, ParseNumbers(absl::StrCat(path, ":", line_number), key,
                                                          line.substr(key.size() + 1)));
    return std::make_optional(numbers);
  }
  return std::optional<std::array<double, 12>>();
}

absl::StatusOr<std::optional<Pose<Camera0, Base>>> ReadTr(const std::string& path) {
  GEM_ASSIGN_OR_RETURN(const auto numbers, ReadCalibrationLine(path, "Tr"));
  if (!numbers) return std::optional<Pose<Camera0, Base>>();
  GEM_ASSIGN_OR_RETURN(const RigidTransform Tr, ParsePose(path + ": Tr", numbers->data()));
  return std::make_optional(Tr.As<Camera0, Base>());
}

absl::StatusOr<KittiCamera> ReadKittiCamera(const std::string& path, int number) {
  const std::string key = absl::StrCat("P", number);
  GEM_ASSIGN_OR_RETURN(const auto numbers, ReadCalibrationLine(path, key));
  if (!numbers) return absl::NotFoundError(absl::StrCat(path, ": no line \"", key, ":\""));
  const auto& P = *numbers;
  const CameraModel model{P[0], P[5], P[2], P[6]};
  if (!(model.fx_px > 0 && model.fy_px > 0) || P[10] != 1)
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ", key, " has focal lengths ", P[0], " and ", P[5],
                     " and P(2, 2) = ", P[10], ", want positive ones and 1: a rectified camera"));
  const double z_m = P[11];
  return KittiCamera{
      model, Pose<Camera, Camera0>::FromTranslation((P[3] - model.cx_px * z_m) / model.fx_px,
                                                    (P[7] - model.cy_px * z_m) / model.fy_px, z_m)};
}

absl::StatusOr<PoseFile> ReadBasePoses(const std::string& path,
                                       const std::optional<Pose<Camera0, Base>>& T_C0_B) {
  GEM_ASSIGN_OR_RETURN(PoseFile file, ReadPoseFile(path));
  if (T_C0_B) {
    for (RigidTransform& pose : file.poses) {
      const Pose<Base, Base> moved = T_C0_B->Inverse() * pose.As<Camera0, Camera0>() * *T_C0_B;
      pose = {moved.rotation(), moved.translation()};
    }
  }
  return file;
}

}  // namespace gem
