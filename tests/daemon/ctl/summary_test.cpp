// What a person reads: known figures with their uncertainty, nothing invented for unknown ones.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/ctl/summary.h"

namespace granary {
namespace {

using testing::HasSubstr;
using testing::Not;

Measurement Good() {
  Measurement m;
  m.valid = true;
  m.reason = Reason::kOk;
  m.utc = UtcTime(std::chrono::seconds(1'795'000'000));
  m.volume_m3 = 0.0190123;
  m.volume_u95_m3 = 0.000123;
  return m;
}
Bin Bay() {
  Bin bin;
  bin.name = "bay-1";
  return bin;
}

TEST(Summary, VolumeHasTheDigitsOfItsUncertainty) {
  EXPECT_THAT(Summary(Good(), Bay()), HasSubstr("0.01901 ± 0.00012 m³"));
}
TEST(Summary, UnknownFiguresAreLeftOut) {
  const std::string text = Summary(Good(), Bay());
  EXPECT_THAT(text, Not(HasSubstr("error rate")));
  EXPECT_THAT(text, Not(HasSubstr("quantity")));
  EXPECT_THAT(text, HasSubstr("reference   none"));
}
TEST(Summary, AnInvalidMeasurementSaysWhyAndWhatToDo) {
  Measurement m;
  m.reason = Reason::kReferenceMissing;
  m.detail = "nothing stored";
  const std::string text = Summary(m, Bay());
  EXPECT_THAT(text, HasSubstr("INVALID: reference_missing"));
  EXPECT_THAT(text, HasSubstr("nothing stored"));
  EXPECT_THAT(text, HasSubstr("remedy"));
}
TEST(Summary, SimulatedFiguresAreMarked) {
  Measurement m = Good();
  m.simulated = true;
  EXPECT_THAT(Summary(m, Bay()), HasSubstr("(simulated)"));
}
TEST(Summary, AnAbnormalErrorRateStandsOut) {
  Measurement m = Good();
  m.error_rate_percent = -4.25;
  m.abnormal = true;
  EXPECT_THAT(Summary(m, Bay()), HasSubstr("-4.25 % against the book: ABNORMAL"));
}

}  // namespace
}  // namespace granary
