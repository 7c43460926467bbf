// Colours, from an image to an orthophoto: what is known comes out as it was sent, what is not
// stays transparent.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "client/formats/png_file.h"
#include "tests/end_to_end/exported_map.h"
#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

constexpr Rgb kRed{200, 10, 20};
constexpr Rgb kBlue{5, 6, 250};
constexpr double kRedNumber = 200 * 65536 + 10 * 256 + 20;
constexpr double kBlueNumber = 5 * 65536 + 6 * 256 + 250;

void Write(const std::string& path, const std::string& contents) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << contents;
}

/// Two scans of flat ground 1.7 m below a velodyne, 4 to 8 m before and behind it, and a camera
/// that looks ahead: red to the left, blue to the right.
void WriteRecording(const ScratchDir& scratch) {
  std::string scan;
  for (const float ahead : {1.0f, -1.0f}) {
    for (float x_m = 4.05f; x_m < 8; x_m += 0.1f) {
      for (float y_m = -2.95f; y_m < 3; y_m += 0.1f) {
        const float point[] = {ahead * x_m, y_m, -1.7f, 0};
        scan.append(reinterpret_cast<const char*>(point), sizeof(point));
      }
    }
  }
  Image image{640, 240, {}};
  for (int i = 0; i < 640 * 240; ++i) image.pixels.push_back(i % 640 < 320 ? kRed : kBlue);
  const std::string photo = ToPng(image).value();
  for (const std::string name : {"000000", "000001"}) {
    Write(scratch.File("drive/velodyne/" + name + ".bin"), scan);
    Write(scratch.File("drive/image_2/" + name + ".png"), photo);
  }
  Write(scratch.File("drive/calib.txt"),
        "P2: 300 0 320 0 0 300 60 0 0 0 1 0\nTr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n");
  Write(scratch.File("drive/times.txt"), "0\n0.1\n");
  // Camera 0: z is forward.
  Write(scratch.File("drive/poses.txt"), "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 0.2\n");
}

void MustRun(std::vector<std::string> arguments) {
  const Finished run = Gem(std::move(arguments));
  ASSERT_EQ(run.exit_code, 0) << run.output;
}

std::vector<std::string> ToFile(std::vector<std::string> command, const ServerProcess& server,
                                const std::string& layer, const std::string& format,
                                const std::string& file) {
  command.insert(command.end(), {"--server", server.address(), "--layer", layer, "--format", format,
                                 "--out", file});
  return command;
}

/// Checks what `gem export` or `gem local` writes of the recording's map.
void ExpectRedAndBlue(const std::vector<std::string>& command, const ServerProcess& server,
                      const ScratchDir& scratch) {
  const std::string elevation_file = scratch.File("elevation.xyz");
  const std::string color_file = scratch.File("color.xyz");
  const std::string picture_file = scratch.File("color.png");
  MustRun(ToFile(command, server, "elevation", "xyz", elevation_file));
  MustRun(ToFile(command, server, "color", "xyz", color_file));
  MustRun(ToFile(command, server, "color", "png", picture_file));

  const ExportedMap elevation = ReadXyz(elevation_file, 0.2);
  const ExportedMap color = ReadXyz(color_file, 0.2);
  EXPECT_GT(color.size(), 500u);
  for (const auto& [cell, number] : color) {
    EXPECT_GT(cell.first, 0) << "a colour behind the camera";
    EXPECT_EQ(number, cell.second >= 0 ? kRedNumber : kBlueNumber)
        << "cell " << cell.first << ", " << cell.second;
  }
  std::size_t num_known_behind = 0;
  for (const auto& [cell, height_m] : elevation) num_known_behind += cell.first < 0;
  EXPECT_GT(num_known_behind, 500u);
  EXPECT_EQ(color.size(), elevation.size() - num_known_behind);

  // x is to the right and y up: what is behind the car is on the left, what is left of it at the
  // top. Transparent pixels read as black.
  const Image picture = ReadPng(picture_file).value();
  std::set<std::tuple<int, int, int>> colors;
  for (const Rgb& pixel : picture.pixels) colors.insert({pixel.red, pixel.green, pixel.blue});
  EXPECT_EQ(colors, (std::set<std::tuple<int, int, int>>{{0, 0, 0}, {200, 10, 20}, {5, 6, 250}}));
  const int ahead = picture.width / 2 + static_cast<int>(6.0 / 20 * picture.width);
  const int beside = static_cast<int>(1.0 / 20 * picture.width);
  EXPECT_EQ(picture.At(ahead, picture.height / 2 - beside), kRed);
  EXPECT_EQ(picture.At(ahead, picture.height / 2 + beside), kBlue);
  EXPECT_EQ(picture.At(picture.width - ahead, picture.height / 2), Rgb{});
}

TEST(Orthophoto, ShowsTheColoursThatTheCameraSaw) {
  const ServerProcess server;
  const ScratchDir scratch;
  WriteRecording(scratch);
  for (const char* encoding : {"float32", "int16", "compact"}) {
    SCOPED_TRACE(encoding);
    const Finished replay =
        Gem({"replay", "kitti", scratch.File("drive"), "--server", server.address(), "--map",
             encoding, "--robot", encoding, "--local_size_m", "20", "--color_images", "image_2",
             "--encoding", encoding});
    ASSERT_EQ(replay.exit_code, 0) << replay.output;
    // The map's extent is that of the window, so that both pictures have the same layout.
    ExpectRedAndBlue({"export", "--map", encoding, "--region", "-10,-10,10,10"}, server, scratch);
    ExpectRedAndBlue({"local", "--robot", encoding}, server, scratch);
  }
}

TEST(Orthophoto, ShowsAStreetFromStereoPairs) {
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) GTEST_SKIP() << "SKIPPED: GEM_DATA_DIR does not name unpacked recordings";
  const ServerProcess server;
  const ScratchDir scratch;
  const Finished replay = Gem({"replay", "kitti", std::string(data) + "/sequences/06", "--stereo",
                               "--scans", "12", "--server", server.address(), "--map", "m"});
  ASSERT_EQ(replay.exit_code, 0) << replay.output;
  const std::vector<std::string> command = {"export", "--map", "m"};
  MustRun(ToFile(command, server, "elevation", "xyz", scratch.File("elevation.xyz")));
  MustRun(ToFile(command, server, "color", "xyz", scratch.File("color.xyz")));
  const ExportedMap elevation = ReadXyz(scratch.File("elevation.xyz"), 0.2);
  const ExportedMap color = ReadXyz(scratch.File("color.xyz"), 0.2);
  // Thirteen metres of path, a street of 15 m between the houses.
  EXPECT_GT(color.size(), 8000u);
  EXPECT_EQ(color.size(), elevation.size()) << "every stereo point has a colour";
  std::size_t num_grey = 0;
  for (const auto& [cell, number] : color) {
    const auto rgb = static_cast<std::uint32_t>(number);
    num_grey += (rgb & 255) == (rgb >> 8 & 255) && (rgb & 255) == rgb >> 16;
  }
  EXPECT_EQ(num_grey, color.size()) << "the images are grey";
}

}  // namespace
}  // namespace gem::test
