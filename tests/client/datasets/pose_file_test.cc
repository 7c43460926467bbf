#include "client/datasets/pose_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/client/temporary_directory.h"

namespace gem {
namespace {

using ::testing::HasSubstr;

constexpr char kIdentity[] = "1 0 0 0 0 1 0 0 0 0 1 0\n";

std::string ErrorOfPoses(const std::string& contents) {
  const TemporaryDirectory dir;
  const absl::StatusOr<PoseFile> file = ReadPoseFile(dir.Write("poses.txt", contents));
  return file.ok() ? "no error" : std::string(file.status().message());
}

std::string ErrorOfTimes(const std::string& contents) {
  const TemporaryDirectory dir;
  const absl::StatusOr<TimesFile> file = ReadTimesFile(dir.Write("times.txt", contents));
  return file.ok() ? "no error" : std::string(file.status().message());
}

TEST(PoseFile, ReadsRowsOfRotationAndTranslation) {
  const TemporaryDirectory dir;
  // Yaw by 90 degrees: x goes to y.
  const absl::StatusOr<PoseFile> file =
      ReadPoseFile(dir.Write("p.txt", std::string(kIdentity) + "0 -1 0 7 1 0 0 8 0 0 1 9\n"));
  ASSERT_TRUE(file.ok()) << file.status();
  ASSERT_EQ(file->poses.size(), 2u);
  const Point<Odom> p_O = file->poses[1].As<Odom, Base>() * Point<Base>(1, 0, 0);
  EXPECT_NEAR(p_O.x(), 7, 1e-12);
  EXPECT_NEAR(p_O.y(), 9, 1e-12);
  EXPECT_NEAR(p_O.z(), 9, 1e-12);
}

TEST(PoseFile, KeepsAUnitQuaternionOfAMatrixWithSixDigits) {
  const TemporaryDirectory dir;
  const absl::StatusOr<PoseFile> file = ReadPoseFile(
      dir.Write("p.txt",
                "0.480565 -0.87665 0.0232866 0.687383 0.876925 0.48061 -0.00401009 0.55236 "
                "-0.0076763 0.0223477 0.999721 0.786151"));
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_NEAR(file->poses[0].rotation.norm(), 1, 1e-15);
}

TEST(PoseFile, SkipsEmptyLinesAndCommentsButCountsThem) {
  const TemporaryDirectory dir;
  const absl::StatusOr<PoseFile> file =
      ReadPoseFile(dir.Write("p.txt", "# x\r\n\n" + std::string(kIdentity) + "\n"));
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(file->lines, std::vector<std::size_t>{3});
}

TEST(PoseFile, NamesTheLineThatHasTooFewOrTooManyNumbers) {
  EXPECT_THAT(ErrorOfPoses(std::string(kIdentity) + "1 0 0 0 0 1 0 0 0 0 1\n"),
              HasSubstr("poses.txt:2: 11 numbers, want 12"));
  EXPECT_THAT(ErrorOfPoses("1 0 0 0 0 1 0 0 0 0 1 0 0\n"),
              HasSubstr("poses.txt:1: 13 numbers, want 12"));
}

TEST(PoseFile, NamesTheNumberThatIsNone) {
  EXPECT_THAT(ErrorOfPoses("1 0 0 0 0 one 0 0 0 0 1 0\n"),
              HasSubstr("poses.txt:1: number 6 is \"one\", want a finite number"));
  EXPECT_THAT(ErrorOfPoses("1 0 0 nan 0 1 0 0 0 0 1 0\n"), HasSubstr(":1: number 4 is \"nan\""));
  EXPECT_THAT(ErrorOfPoses("1 0 0 0 0 1 0 inf 0 0 1 0\n"), HasSubstr(":1: number 8 is \"inf\""));
}

TEST(PoseFile, RefusesARotationThatIsNone) {
  EXPECT_THAT(ErrorOfPoses(std::string(kIdentity) + "1.1 0 0 0 0 1 0 0 0 0 1 0\n"),
              HasSubstr("poses.txt:2: the rotation is not orthonormal: R * R^T differs from "
                        "identity by 0.21"));
  EXPECT_THAT(ErrorOfPoses("1 0 0 0 0 1 0 0 0 0 -1 0\n"),
              HasSubstr("poses.txt:1: the rotation is a reflection"));
  EXPECT_THAT(ErrorOfPoses("0 0 0 0 0 0 0 0 0 0 0 0\n"), HasSubstr("not orthonormal"));
}

TEST(PoseFile, RefusesATranslationBeyondTheWorld) {
  EXPECT_THAT(ErrorOfPoses("1 0 0 2e6 0 1 0 0 0 0 1 0\n"),
              HasSubstr("poses.txt:1: the translation holds 2e+06 m, want at most 1e+06"));
}

TEST(PoseFile, NamesAFileThatIsNotThere) {
  EXPECT_THAT(std::string(ReadPoseFile("/nowhere/poses.txt").status().message()),
              HasSubstr("/nowhere/poses.txt: no such file"));
}

TEST(TimesFile, RoundsToWholeNanoseconds) {
  const TemporaryDirectory dir;
  const absl::StatusOr<TimesFile> file =
      ReadTimesFile(dir.Write("times.txt", "-0.5\n1.037359e-01\n2.8000000004\n"));
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(file->stamps_ns, (std::vector<std::int64_t>{-500'000'000, 103'735'900, 2'800'000'000}));
}

TEST(TimesFile, RefusesTimesThatDoNotIncrease) {
  EXPECT_THAT(ErrorOfTimes("1\n2\n\n2\n"),
              HasSubstr("times.txt:4: time 2 s does not follow 2 s of line 2"));
  // Different as text, the same nanosecond.
  EXPECT_THAT(ErrorOfTimes("1.0000000001\n1.0000000002\n"), HasSubstr("times.txt:2: time 1 s"));
}

TEST(TimesFile, RefusesTimesThatDoNotFitNanoseconds) {
  EXPECT_THAT(ErrorOfTimes("1e10\n"),
              HasSubstr("times.txt:1: time is 1e+10 s, want at most 9e+09"));
}

TEST(StampedPoses, NeedAsManyPosesAsTimes) {
  const TemporaryDirectory dir;
  const auto trajectory = ReadStampedPoses<Global, Base>(dir.Write("poses.txt", kIdentity),
                                                         dir.Write("times.txt", "1\n2\n"));
  EXPECT_THAT(std::string(trajectory.status().message()),
              ::testing::AllOf(HasSubstr("poses.txt has 1 poses"), HasSubstr("has 2 times")));
}

TEST(StampedPoses, PairPosesWithTimes) {
  const TemporaryDirectory dir;
  const auto trajectory = ReadStampedPoses<Global, Base>(
      dir.Write("poses.txt", std::string(kIdentity) + "1 0 0 5 0 1 0 0 0 0 1 0\n"),
      dir.Write("times.txt", "1\n2\n"));
  ASSERT_TRUE(trajectory.ok()) << trajectory.status();
  ASSERT_EQ(trajectory->size(), 2u);
  EXPECT_EQ((*trajectory)[1].stamp_ns, 2'000'000'000);
  EXPECT_EQ((*trajectory)[1].T_A_B.translation().x(), 5);
}

}  // namespace
}  // namespace gem
