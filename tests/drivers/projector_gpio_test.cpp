#include "drivers/projector_gpio.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "drivers/errors.h"
#include "tests/drivers/gpio/fake_line.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::HasSubstr;

enum class Wiring { kOneLine, kTriggerLine };
enum class Time { kFake, kReal };

ProjectorOptions Options(std::chrono::milliseconds max_on = 1000ms) {
  ProjectorOptions options;
  options.driver = ProjectorDriver::kGpio;
  options.chip = "chip";
  options.line = 17;
  options.max_on = max_on;
  options.max_duty_percent = 100;
  return options;
}

/// By default the guard's second never comes: only the clock of the pulse is fast.
struct Bench {
  explicit Bench(const ProjectorOptions& options = Options(), Wiring wiring = Wiring::kOneLine, Time time = Time::kFake)
      : projector(std::make_unique<ProjectorGpio>(
            options, std::make_unique<FakeLine>(board, "light"),
            wiring == Wiring::kTriggerLine ? std::make_unique<FakeLine>(board, "trigger") : nullptr,
            time == Time::kFake ? board->Clock() : SystemPulseClock())) {}

  std::optional<DeviceError> Fault(std::chrono::microseconds width = 1ms, const std::function<void()>& lit = {}) {
    try {
      (void)projector->Pulse(width, lit);
    } catch (const DeviceError& error) {
      return error;
    }
    return std::nullopt;
  }
  std::function<void()> HoldUpUntilDark() {
    return [this] { EXPECT_TRUE(board->WaitFor("light off")) << "the guard did not switch off"; };
  }

  std::shared_ptr<FakeBoard> board = std::make_shared<FakeBoard>();
  std::unique_ptr<ProjectorGpio> projector;
};

TEST(ProjectorGpio, DoesNotLightWhenBuilt) {
  const Bench bench;
  EXPECT_THAT(bench.board->Names(), testing::Not(testing::Contains("light on")));
}

TEST(Pulse, LightsForTheWidth) {
  Bench bench;
  bench.projector->Pulse(8200us);
  EXPECT_THAT(bench.board->Names(), ElementsAre("light on", "light off"));
  const auto lit = bench.board->TimeOf("light off") - bench.board->TimeOf("light on");
  EXPECT_GE(lit, 8200us);
  EXPECT_LE(lit, 8220us) << "every look at the fake clock takes a microsecond";
}

TEST(Pulse, CallsBackOnceTheLightHasSettled) {
  Bench bench;
  bench.projector->Pulse(8200us, [&] { bench.board->Note("lit"); });
  EXPECT_THAT(bench.board->Names(), ElementsAre("light on", "lit", "light off"));
  EXPECT_GE(bench.board->TimeOf("lit") - bench.board->TimeOf("light on"), 200us);
}

TEST(Pulse, FiresTheTriggerLineInTheSettledLight) {
  Bench bench(Options(), Wiring::kTriggerLine);
  bench.projector->Pulse(8200us, [&] { bench.board->Note("lit"); });
  EXPECT_THAT(bench.board->Names(), ElementsAre("light on", "trigger on", "lit", "light off", "trigger off"));
  EXPECT_GE(bench.board->TimeOf("trigger on") - bench.board->TimeOf("light on"), 200us);
}

TEST(Pulse, CountsTheCallbackAsTimeOfThePulse) {
  Bench bench;
  bench.projector->Pulse(8200us, [&] { bench.board->clock.Advance(5000us); });
  EXPECT_LE(bench.board->TimeOf("light off") - bench.board->TimeOf("light on"), 8220us);
}

TEST(Pulse, TellsWhenTheGrainWasSurelyLit) {
  Bench bench;
  const LitInterval lit = bench.projector->Pulse(8200us);
  EXPECT_GT(lit.from, FakePulseClock::UtcOf(bench.board->TimeOf("light on")));
  EXPECT_LT(lit.until, FakePulseClock::UtcOf(bench.board->TimeOf("light off")));
  EXPECT_GE(lit.until - lit.from, 8190us);
}

TEST(Pulse, IsDarkAfterTheCallbackThrew) {
  Bench bench(Options(), Wiring::kTriggerLine);
  EXPECT_THROW(bench.projector->Pulse(1ms, [] { throw std::runtime_error("from the callback"); }), std::runtime_error);
  EXPECT_FALSE(bench.board->light);
  EXPECT_FALSE(bench.board->trigger);
}

TEST(Pulse, IsDarkAfterTheTriggerLineThrew) {
  Bench bench(Options(), Wiring::kTriggerLine);
  bench.board->fail_trigger_on = 1;
  EXPECT_EQ(bench.Fault().value().reason(), Reason::kProjectorFault);
  EXPECT_FALSE(bench.board->light);
}

TEST(Pulse, ThrowsWhenTheTriggerLineStaysOn) {
  Bench bench(Options(), Wiring::kTriggerLine);
  bench.board->fail_trigger_off = 1;
  EXPECT_THAT(bench.Fault().value().what(), HasSubstr("trigger off"));
  EXPECT_FALSE(bench.board->light);
}

TEST(Pulse, IsDarkAfterALightThatRoseAndThrew) {
  Bench bench;
  bench.board->fail_light_on = 1;
  bench.board->rises_before_failing = true;
  EXPECT_EQ(bench.Fault().value().reason(), Reason::kProjectorFault);
  EXPECT_FALSE(bench.board->light);
  EXPECT_EQ(bench.Fault(), std::nullopt) << "the next pulse works again";
}

TEST(Pulse, RefusesMoreThanMaxOn) {
  Bench bench(Options(50ms));
  EXPECT_THROW(bench.projector->Pulse(50001us), std::invalid_argument);
  EXPECT_THROW(bench.projector->Pulse(0us), std::invalid_argument);
  EXPECT_THAT(bench.board->Names(), ElementsAre());
}

TEST(Pulse, LeavesAWidthOfMaxOnToItsOwnThreadOrTheGuard) {
  Bench bench(Options(2ms), Wiring::kOneLine, Time::kReal);
  const LitInterval lit = bench.projector->Pulse(2ms);
  EXPECT_GT(lit.until, lit.from);
  EXPECT_FALSE(bench.board->light);
}

TEST(Guard, SwitchesOffWhileThePulseIsHeldUp) {
  Bench bench(Options(1ms), Wiring::kTriggerLine, Time::kReal);
  const auto fault = bench.Fault(1ms, bench.HoldUpUntilDark());
  ASSERT_TRUE(fault);
  EXPECT_EQ(fault->reason(), Reason::kProjectorGuard);
  EXPECT_THAT(fault->what(), HasSubstr("max_on_ms"));
  EXPECT_FALSE(bench.board->trigger);
}

TEST(Guard, SwitchesOffWhatRoseTooLate) {
  Bench bench(Options(1ms), Wiring::kOneLine, Time::kReal);
  bench.board->rise_takes_us = 2000;
  EXPECT_EQ(bench.Fault().value().reason(), Reason::kProjectorGuard);
  EXPECT_FALSE(bench.board->light);
}

TEST(Guard, IsReportedOnce) {
  Bench bench(Options(5ms), Wiring::kOneLine, Time::kReal);
  ASSERT_TRUE(bench.Fault(1ms, bench.HoldUpUntilDark()));
  EXPECT_EQ(bench.Fault(5ms), std::nullopt);
  EXPECT_EQ(bench.board->Count("light on"), 2);
}

TEST(Guard, IsReportedByTheNextPulseWhereTheCallbackThrew) {
  Bench bench(Options(5ms), Wiring::kOneLine, Time::kReal);
  EXPECT_THROW(bench.projector->Pulse(1ms,
                                      [&] {
                                        bench.HoldUpUntilDark()();
                                        throw std::runtime_error("from the callback");
                                      }),
               std::runtime_error);
  EXPECT_EQ(bench.Fault(5ms).value().reason(), Reason::kProjectorGuard);
  EXPECT_EQ(bench.board->Count("light on"), 1) << "it is reported without lighting";
  EXPECT_EQ(bench.Fault(5ms), std::nullopt);
}

TEST(Guard, TriesAgainWhileTheLineFails) {
  Bench bench(Options(1ms), Wiring::kOneLine, Time::kReal);
  bench.board->fail_light_off = 3;
  const auto fault = bench.Fault(1ms, bench.HoldUpUntilDark());
  ASSERT_TRUE(fault);
  EXPECT_EQ(bench.board->Count("light off fails"), 3);
  EXPECT_THAT(fault->what(), HasSubstr("fails on request")) << "what the line answered is told";
}

TEST(Guard, TakesOverWhereThePulseCannotSwitchOff) {
  Bench bench;
  bench.board->fail_light_off = 2;
  EXPECT_EQ(bench.Fault().value().reason(), Reason::kProjectorFault);
  EXPECT_TRUE(bench.board->WaitFor("light off"));
  EXPECT_FALSE(bench.board->light);
}

TEST(Pulse, DoesNotBeginWhileTheLightCannotBeSwitchedOff) {
  Bench bench;
  bench.board->fail_light_off = 1'000'000;
  EXPECT_TRUE(bench.Fault());
  EXPECT_THAT(bench.Fault().value().what(), HasSubstr("fails on request"));
  EXPECT_EQ(bench.board->Count("light on"), 1);

  bench.board->fail_light_off = 0;
  ASSERT_TRUE(bench.board->WaitFor("light off"));
  // What the guard met meanwhile may still have to be told.
  (void)bench.Fault();
  EXPECT_EQ(bench.Fault(), std::nullopt);
}

TEST(ProjectorGpio, IsDarkWhenDestroyedWhileLit) {
  auto bench = std::make_unique<Bench>();
  const auto board = bench->board;
  board->fail_light_off = 2;
  EXPECT_TRUE(bench->Fault());
  bench.reset();
  EXPECT_FALSE(board->light);
}

ProjectorOptions TenPercent() {
  ProjectorOptions options = Options();
  options.max_duty_percent = 10;
  return options;
}

TEST(DutyLimit, RefusesThePulseThatWouldExceedIt) {
  Bench bench(TenPercent());
  ASSERT_EQ(bench.Fault(900ms), std::nullopt);
  const auto fault = bench.Fault(200ms);
  ASSERT_TRUE(fault);
  EXPECT_EQ(fault->reason(), Reason::kProjectorGuard);
  EXPECT_THAT(fault->what(), HasSubstr("max_duty_percent"));
  EXPECT_EQ(bench.board->Count("light on"), 1) << "refused without lighting";
}

TEST(DutyLimit, SaysWhenThePulseIsAllowed) {
  Bench bench(TenPercent());
  ASSERT_EQ(bench.Fault(900ms), std::nullopt);
  // 100 ms of the first pulse, which ended just now, have to leave the ten seconds that end with this one.
  EXPECT_THAT(bench.Fault(200ms).value().what(), HasSubstr("allowed again in 9000.0 ms"));
  bench.board->clock.Advance(8900ms);
  EXPECT_TRUE(bench.Fault(200ms));
  bench.board->clock.Advance(101ms);
  EXPECT_EQ(bench.Fault(200ms), std::nullopt);
}

TEST(DutyLimit, CountsTheTimeItReallyWasLit) {
  Bench bench(TenPercent());
  ASSERT_EQ(bench.Fault(1ms, [&] { bench.board->clock.Advance(950ms); }), std::nullopt);
  EXPECT_TRUE(bench.Fault(100ms));
}

TEST(DutyLimit, CountsAPulseWhoseCallbackThrew) {
  Bench bench(TenPercent());
  EXPECT_THROW(bench.projector->Pulse(1ms,
                                      [&] {
                                        bench.board->clock.Advance(950ms);
                                        throw std::runtime_error("from the callback");
                                      }),
               std::runtime_error);
  EXPECT_TRUE(bench.Fault(100ms));
}

TEST(DutyLimit, SaysThatAPulseIsNeverAllowed) {
  ProjectorOptions options = Options();
  options.max_duty_percent = 0.05;  // 5 ms in ten seconds
  Bench bench(options);
  EXPECT_THAT(bench.Fault(8ms).value().what(), HasSubstr("never allowed"));
}

TEST(TriggerDark, FiresTheTriggerLineAlone) {
  Bench bench(Options(), Wiring::kTriggerLine);
  EXPECT_TRUE(bench.projector->TriggerDark());
  EXPECT_THAT(bench.board->Names(), ElementsAre("trigger on", "trigger off"));
}

TEST(TriggerDark, IsNotThereOnOneLine) {
  Bench bench;
  EXPECT_FALSE(bench.projector->TriggerDark());
  EXPECT_THAT(bench.board->Names(), ElementsAre());
}

TEST(TriggerDark, ThrowsWhenTheLineFails) {
  Bench bench(Options(), Wiring::kTriggerLine);
  bench.board->fail_trigger_off = 1;
  EXPECT_THROW(bench.projector->TriggerDark(), DeviceError);
}

}  // namespace
}  // namespace granary
