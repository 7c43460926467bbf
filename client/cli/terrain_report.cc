#include "client/cli/terrain_report.h"

#include <cmath>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/cli/json.h"

namespace gem::client {
namespace {

std::string VersionJson(const MapVersion& version) {
  return absl::StrCat("\"epoch\":", version.epoch, ",\"revision\":", version.revision);
}

std::string PlaceJson(const Place& place) {
  return absl::StrCat("\"x_m\":", JsonNumber(place.x_m), ",\"y_m\":", JsonNumber(place.y_m));
}

/// What is not known is null.
std::string GroundJson(const GroundSample& ground) {
  const bool known = ground.state != GroundState::kUnknown;
  const auto number = [](bool is_there, float value) {
    return is_there ? JsonNumber(value) : std::string("null");
  };
  return absl::StrCat(
      "\"state\":", JsonText(NameOf(ground.state)),
      ",\"elevation_m\":", number(known, ground.elevation_m),
      ",\"variance_m2\":", number(known, ground.variance_m2),
      ",\"traversability\":", number(ground.annotated(), ground.traversability),
      ",\"slope_rad\":", number(ground.slope_rad.has_value(), ground.slope_rad.value_or(0)));
}

std::string SampleJson(const PathSample& sample) {
  return absl::StrCat("{\"distance_m\":", JsonNumber(sample.distance_m), ",",
                      PlaceJson(sample.position), ",\"ground\":{", GroundJson(sample.ground),
                      "},\"worst\":", JsonText(NameOf(sample.worst)),
                      ",\"traversability_min\":", JsonNumber(sample.traversability_min),
                      ",\"slope_rad_max\":", JsonNumber(sample.slope_rad_max),
                      ",\"unknown_share\":", JsonNumber(sample.unknown_share), "}");
}

/// "obstacle, 0.412 m, slope 31.2 deg".
std::string GroundText(const GroundSample& ground) {
  std::string text(NameOf(ground.state));
  if (ground.state == GroundState::kUnknown) return text;
  absl::StrAppendFormat(&text, ", height %.3f m +- %.3f m", ground.elevation_m,
                        std::sqrt(ground.variance_m2));
  if (ground.annotated())
    absl::StrAppendFormat(&text, ", traversability %.2f", ground.traversability);
  if (ground.slope_rad) absl::StrAppendFormat(&text, ", slope %.3f rad", *ground.slope_rad);
  return text;
}

}  // namespace

absl::string_view NameOf(GroundState state) {
  switch (state) {
    case GroundState::kFree:
      return "free";
    case GroundState::kHeightOnly:
      return "height_only";
    case GroundState::kObstacle:
      return "obstacle";
    case GroundState::kUnknown:
      break;
  }
  return "unknown";
}

absl::StatusOr<Place> ParsePlace(absl::string_view option, const std::string& text) {
  const std::vector<std::string> numbers = absl::StrSplit(text, ',');
  Place place;
  if (numbers.size() == 2 && absl::SimpleAtod(numbers[0], &place.x_m) &&
      absl::SimpleAtod(numbers[1], &place.y_m))
    return place;
  return absl::InvalidArgumentError(
      absl::StrCat(option, " has \"", text, "\", want X,Y in metres of G"));
}

std::string HeightsTable(const std::vector<Place>& points, const GroundHeights& heights) {
  std::string text;
  for (std::size_t i = 0; i < points.size(); ++i)
    absl::StrAppendFormat(&text, "%g,%g: %s\n", points[i].x_m, points[i].y_m,
                          GroundText(heights.samples[i]));
  return text;
}

std::string HeightsJson(const std::vector<Place>& points, const GroundHeights& heights) {
  std::vector<std::string> samples;
  for (std::size_t i = 0; i < points.size(); ++i)
    samples.push_back(
        absl::StrCat("{", PlaceJson(points[i]), ",", GroundJson(heights.samples[i]), "}"));
  return absl::StrCat("{", VersionJson(heights.version),
                      ",\"samples\":", JsonArray(samples, [](const auto& json) { return json; }),
                      "}\n");
}

std::string PathText(const CheckedPath& path) {
  const PathCheck& check = path.check;
  std::string text = check.free
                         ? absl::StrFormat("free: %.2f m\n", check.free_distance_m)
                         : absl::StrFormat("not free: %.2f of %.2f m\n", check.free_distance_m,
                                           check.samples.back().distance_m);
  absl::StrAppendFormat(&text, "worst cell at %g,%g, %.2f m from the start: %s\n",
                        check.worst.position.x_m, check.worst.position.y_m,
                        check.samples[check.worst.sample].distance_m,
                        GroundText(check.worst.ground));
  return text;
}

std::string PathJson(const CheckedPath& path) {
  const PathCheck& check = path.check;
  return absl::StrCat("{", VersionJson(path.version), ",\"free\":", JsonBool(check.free),
                      ",\"free_distance_m\":", JsonNumber(check.free_distance_m), ",\"worst\":{",
                      PlaceJson(check.worst.position), ",\"sample\":", check.worst.sample,
                      ",\"ground\":{", GroundJson(check.worst.ground),
                      "}},\"samples\":", JsonArray(check.samples, SampleJson), "}\n");
}

}  // namespace gem::client
