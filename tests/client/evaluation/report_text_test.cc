#include "client/evaluation/report_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace gem::evaluation {
namespace {

using testing::HasSubstr;
using testing::Not;

Report SomeReport() {
  Report report{.name = "cubes", .title = "Table I", .method = "Cubes are scanned."};
  report.figures = {
      {.name = "height error", .value = 0.3, .unit = "cm", .at_most = 0.2, .paper = 0.4}};
  report.tables = {{"errors", {"cell", "error"}, {{"0.1", "0.3"}}}};
  report.plots = {{.name = "errors", .title = "Errors", .series = {{"a", {1}, {2}}}}};
  report.skipped = {"real data: no \"--data\""};
  return report;
}

TEST(Figure, IsMissedBeyondItsAimAndWhenItIsNotANumber) {
  EXPECT_FALSE((Figure{.value = 1, .at_most = 1}).missed());
  EXPECT_TRUE((Figure{.value = 1.1, .at_most = 1}).missed());
  EXPECT_TRUE((Figure{.value = 0.9, .at_least = 1}).missed());
  EXPECT_FALSE((Figure{.value = 5}).missed());
  EXPECT_TRUE((Figure{.value = std::numeric_limits<double>::quiet_NaN(), .at_most = 1}).missed());
}

TEST(Markdown, ShowsFiguresBesideTheirAimsAndThePaper) {
  const std::string text = Markdown(SomeReport(), "plots");
  EXPECT_THAT(text, HasSubstr("| height error | 0.3 | cm | at most 0.2 **missed** | 0.4 |"));
  EXPECT_THAT(text, HasSubstr("| 0.1 | 0.3 |"));
  EXPECT_THAT(text, HasSubstr("![Errors](plots/cubes/errors.svg)"));
  EXPECT_THAT(text, HasSubstr("Skipped: real data"));
}

TEST(Json, EscapesTextAndHasNoWordForNotANumber) {
  Report report = SomeReport();
  report.figures[0].value = std::numeric_limits<double>::infinity();
  const std::string text = Json(report);
  EXPECT_THAT(text, HasSubstr(R"(no \"--data\")"));
  EXPECT_THAT(text, HasSubstr(R"("value":null)"));
  EXPECT_THAT(text, Not(HasSubstr("inf")));
}

}  // namespace
}  // namespace gem::evaluation
