#include "daemon/cycle.h"

#include <gtest/gtest.h>

#include <deque>
#include <stdexcept>

#include "tests/daemon/fakes.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using S = CycleState;

/// A cycle whose captures and verdicts are scripted; what the script does not say succeeds with 0.019 m³.
struct Bench {
  FakeClock clock;
  CycleOptions options;
  std::deque<Reason> captures;  // kOk: frames come
  std::deque<Measurement> verdicts;
  std::vector<Measurement> published;
  std::vector<CycleState> states;
  std::stop_source stop;
  std::optional<Measurement> good;

  Cycle Make() {
    CycleSteps steps;
    steps.capture = [this]() -> std::vector<Shot> {
      const Reason reason = captures.empty() ? Reason::kOk : captures.front();
      if (!captures.empty()) captures.pop_front();
      clock.Advance(20ms);
      if (reason != Reason::kOk) throw DeviceError(reason, "left camera", "grab", "no trigger came");
      return std::vector<Shot>(1);
    };
    steps.measure = [this](const std::vector<Shot>&) {
      Measurement verdict = verdicts.empty() ? Valid(0.019) : verdicts.front();
      if (!verdicts.empty()) verdicts.pop_front();
      return verdict;
    };
    steps.publish = [this](const Measurement& m) { published.push_back(m); };
    steps.entered = [this](CycleState state) { states.push_back(state); };
    return Cycle(options, std::move(steps), clock, good);
  }
};

TEST(Cycle, GoesThroughItsStatesInOrder) {
  Bench bench;
  bench.Make().Run(bench.stop.get_token());
  EXPECT_EQ(bench.states, (std::vector{S::kCapturing, S::kMeasuring, S::kGating, S::kPublishing, S::kIdle}));
}

TEST(Cycle, PublishesWhatWasMeasured) {
  Bench bench;
  const auto measurement = bench.Make().Run(bench.stop.get_token());
  ASSERT_TRUE(measurement);
  EXPECT_TRUE(measurement->valid);
  EXPECT_EQ(bench.published.size(), 1U);
}

TEST(Cycle, TimesTheCaptureAndStampsItsStart) {
  Bench bench;
  const UtcTime start = bench.clock.Now();
  const auto measurement = bench.Make().Run(bench.stop.get_token());
  EXPECT_EQ(measurement->utc, start);  // the fake frames know no exposure time
  EXPECT_DOUBLE_EQ(measurement->timings_ms.capture, 20.0);
}

TEST(Cycle, RetriesAFailedCapture) {
  Bench bench;
  bench.captures = {Reason::kFrameMissing};
  EXPECT_TRUE(bench.Make().Run(bench.stop.get_token())->valid);
  EXPECT_EQ(bench.states, (std::vector{S::kCapturing, S::kGating, S::kRetrying, S::kCapturing, S::kMeasuring,
                                       S::kGating, S::kPublishing, S::kIdle}));
}

TEST(Cycle, RetriesAPoorPicture) {
  Bench bench;
  bench.verdicts = {Verdict(Reason::kLowContrast)};
  EXPECT_TRUE(bench.Make().Run(bench.stop.get_token())->valid);
}

TEST(Cycle, WaitsBetweenAttempts) {
  Bench bench;
  bench.options.retry_delay = 7s;
  bench.captures = {Reason::kFrameMissing};
  bench.Make().Run(bench.stop.get_token());
  EXPECT_EQ(bench.clock.waited(), 7s + 2 * 20ms);
}

TEST(Cycle, GivesUpAfterItsAttemptsWithTheLastReason) {
  Bench bench;
  bench.options.attempts = 3;
  bench.captures = {Reason::kFrameMissing, Reason::kFrameMissing, Reason::kSkewTooLarge};
  const auto measurement = bench.Make().Run(bench.stop.get_token());
  EXPECT_FALSE(measurement->valid);
  EXPECT_EQ(measurement->reason, Reason::kSkewTooLarge);
  EXPECT_EQ(measurement->detail, "left camera: grab: no trigger came");
}

TEST(Cycle, LeavesFiguresOfAFailedCycleUnknown) {
  Bench bench;
  bench.options.attempts = 1;
  bench.captures = {Reason::kCameraUnavailable};
  const auto measurement = bench.Make().Run(bench.stop.get_token());
  EXPECT_FALSE(measurement->volume_m3);
  EXPECT_FALSE(measurement->mass_kg);
}

TEST(Cycle, DoesNotRetryWhatWasPreparedWrongly) {
  Bench bench;
  bench.verdicts = {Verdict(Reason::kReferenceMismatch)};
  auto cycle = bench.Make();
  EXPECT_EQ(cycle.Run(bench.stop.get_token())->reason, Reason::kReferenceMismatch);
  EXPECT_EQ(cycle.attempt(), 1);
}

TEST(Cycle, CallsAnUnforeseenExceptionInternal) {
  Bench bench;
  CycleSteps steps;
  steps.capture = [] { return std::vector<Shot>(1); };
  steps.measure = [](const auto&) -> Measurement { throw std::runtime_error("out of luck"); };
  steps.publish = [](const auto&) {};
  Cycle cycle({}, std::move(steps), bench.clock, std::nullopt);
  const auto measurement = cycle.Run(bench.stop.get_token());
  EXPECT_EQ(measurement->reason, Reason::kInternal);
  EXPECT_EQ(measurement->detail, "out of luck");
}

TEST(Cycle, LetsABugThrough) {
  Bench bench;
  CycleSteps steps;
  steps.capture = [] { return std::vector<Shot>(1); };
  steps.measure = [](const auto&) -> Measurement { throw std::logic_error("bug"); };
  Cycle cycle({}, std::move(steps), bench.clock, std::nullopt);
  EXPECT_THROW(cycle.Run(bench.stop.get_token()), std::logic_error);
}

TEST(Cycle, RefusesToBeginTwice) {
  Bench bench;
  auto cycle = bench.Make();
  cycle.Begin();
  EXPECT_THROW(cycle.Begin(), std::logic_error);
}

TEST(Cycle, EndsUnpublishedWhenStoppedBeforeCapture) {
  Bench bench;
  bench.stop.request_stop();
  EXPECT_FALSE(bench.Make().Run(bench.stop.get_token()));
  EXPECT_EQ(bench.states, (std::vector{S::kCapturing, S::kIdle}));
}

TEST(Cycle, EndsUnpublishedWhenAStopInterruptsTheCapture) {
  Bench bench;
  auto cycle = bench.Make();
  bench.captures = {Reason::kFrameMissing};
  cycle.Begin();
  cycle.Step({});
  bench.stop.request_stop();
  cycle.Step(bench.stop.get_token());
  EXPECT_EQ(cycle.state(), S::kIdle);
  EXPECT_TRUE(bench.published.empty());
}

TEST(Cycle, EndsUnpublishedWhenStoppedBetweenAttempts) {
  Bench bench;
  auto cycle = bench.Make();
  bench.captures = {Reason::kFrameMissing};
  cycle.Begin();
  while (cycle.state() != S::kRetrying) cycle.Step({});
  bench.stop.request_stop();
  cycle.Step(bench.stop.get_token());
  EXPECT_EQ(cycle.state(), S::kIdle);
}

TEST(Cycle, StillPublishesAFigureThatIsThereWhenStopped) {
  Bench bench;
  auto cycle = bench.Make();
  cycle.Begin();
  while (cycle.state() != S::kGating) cycle.Step({});
  bench.stop.request_stop();
  while (cycle.state() != S::kIdle) cycle.Step(bench.stop.get_token());
  EXPECT_EQ(bench.published.size(), 1U);
}

TEST(Trial, PublishesAMeasurement) {
  Bench bench;
  EXPECT_TRUE(bench.Make().Run(bench.stop.get_token(), CycleKind::kTrial));
  EXPECT_EQ(bench.published.size(), 1U);
}

TEST(Trial, LeavesNoTraceWhenItFails) {
  Bench bench;
  bench.captures = {Reason::kFrameMissing};
  EXPECT_FALSE(bench.Make().Run(bench.stop.get_token(), CycleKind::kTrial));
  EXPECT_TRUE(bench.published.empty());
  EXPECT_EQ(bench.states, (std::vector{S::kCapturing, S::kGating, S::kIdle}));  // one attempt
}

TEST(Cycle, RejectsAnImplausibleChange) {
  Bench bench;
  bench.options.max_rate_m3_h = 0.001;
  bench.good = Valid(0.019, bench.clock.Now() - 30min);
  bench.verdicts = {Valid(0.010), Valid(0.010), Valid(0.010)};
  const auto measurement = bench.Make().Run(bench.stop.get_token());
  EXPECT_FALSE(measurement->valid);
  EXPECT_EQ(measurement->reason, Reason::kImplausibleChange);
}

TEST(Cycle, RecoversWhenARetryIsPlausible) {
  Bench bench;
  bench.options.max_rate_m3_h = 0.001;
  bench.good = Valid(0.019, bench.clock.Now() - 30min);
  bench.verdicts = {Valid(0.010), Valid(0.0191)};
  EXPECT_TRUE(bench.Make().Run(bench.stop.get_token())->valid);
}

TEST(Cycle, AcceptsAPersistentChangeInTheThirdCycle) {
  Bench bench;
  bench.options.max_rate_m3_h = 0.001;
  bench.options.attempts = 1;
  bench.good = Valid(0.019, bench.clock.Now() - 30min);
  bench.verdicts = {Valid(0.010), Valid(0.01005), Valid(0.0101)};
  auto cycle = bench.Make();
  EXPECT_FALSE(cycle.Run(bench.stop.get_token())->valid);
  EXPECT_FALSE(cycle.Run(bench.stop.get_token())->valid);
  EXPECT_TRUE(cycle.Run(bench.stop.get_token())->valid);
}

TEST(ChangeGate, DoesNotAcceptChangesThatDisagree) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  ChangeGate gate(0.001, Valid(0.019, start));
  for (const double volume_m3 : {0.010, 0.012, 0.010, 0.012, 0.010}) {
    Measurement doubtful = Valid(volume_m3, start + 1h);
    EXPECT_FALSE(gate.Admits(doubtful)) << volume_m3;
    doubtful.valid = false;
    doubtful.reason = Reason::kImplausibleChange;
    gate.Remember(doubtful);
  }
}

TEST(ChangeGate, DoesNotCountCyclesWithoutAVolume) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  ChangeGate gate(0.001, Valid(0.019, start));
  Measurement doubtful = Valid(0.010, start + 1h);
  doubtful.valid = false;
  doubtful.reason = Reason::kImplausibleChange;
  gate.Remember(doubtful);
  gate.Remember(Verdict(Reason::kFrameMissing));
  EXPECT_FALSE(gate.Admits(Valid(0.010, start + 2h)));
  gate.Remember(doubtful);
  EXPECT_TRUE(gate.Admits(Valid(0.010, start + 2h)));
}

TEST(ChangeGate, PassesEverythingWithoutALimit) {
  EXPECT_TRUE(ChangeGate(std::nullopt, Valid(0.019)).Admits(Valid(5.0)));
}

TEST(ChangeGate, PassesTheFirstFigure) { EXPECT_TRUE(ChangeGate(0.001, std::nullopt).Admits(Valid(5.0))); }

TEST(IsPlausibleChange, GrowsWithTheTimeBetween) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  EXPECT_FALSE(IsPlausibleChange(Valid(10, start), Valid(13, start + 1h), 2.0));
  EXPECT_TRUE(IsPlausibleChange(Valid(10, start), Valid(13, start + 2h), 2.0));
}

TEST(IsPlausibleChange, ForgivesTheUncertaintyOfBoth) {
  // 0.0001 m³ each: together √2 · 0.0001.
  EXPECT_TRUE(IsPlausibleChange(Valid(0.019), Valid(0.01914), 1.0));
  EXPECT_FALSE(IsPlausibleChange(Valid(0.019), Valid(0.01915), 1.0));
}

TEST(IsPlausibleChange, AllowsNoChangeAgainstTime) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  EXPECT_FALSE(IsPlausibleChange(Valid(10, start), Valid(11, start - 5h), 2.0));
}

}  // namespace
}  // namespace granary
