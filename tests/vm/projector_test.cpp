// Runs in the guest: the GPIO projector on the kernel's simulated chip, whose lines are looked at from outside.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "drivers/errors.h"
#include "drivers/gpio_line.h"
#include "drivers/projector_gpio.h"
#include "tests/vm/footprint.h"
#include "tests/vm/vivid.h"

namespace granary {
namespace {

using std::chrono::milliseconds;

constexpr int kLight = 3, kTrigger = 5;

std::string FromEnvironment(const char* name) {
  const char* value = std::getenv(name);
  if (value == nullptr) throw std::runtime_error(std::string(name) + " is not set");
  return value;
}

/// The line's level as the chip has it, not as the driver believes.
int Level(int line) {
  std::ifstream value(FromEnvironment("GRANARY_LINES") + "/sim_gpio" + std::to_string(line) + "/value");
  int level = -1;
  value >> level;
  return level;
}

ProjectorOptions Rig() {
  ProjectorOptions options;
  options.driver = ProjectorDriver::kGpio;
  options.chip = FromEnvironment("GRANARY_CHIP");
  options.line = kLight;
  options.max_on = milliseconds(500);
  options.max_duty_percent = 100;
  return options;
}

std::optional<Reason> ReasonOf(const std::function<void()>& action) {
  try {
    action();
    return std::nullopt;
  } catch (const DeviceError& error) {
    std::cout << error.what() << '\n';
    return error.reason();
  }
}

/// Another program that is in the middle of a pulse, as a daemon would be.
class PulsingProgram {
 public:
  explicit PulsingProgram(const ProjectorOptions& options) : pid_(fork()) {
    if (pid_ < 0) throw std::runtime_error("fork failed");
    if (pid_ > 0) return;
    try {
      ProjectorGpio projector(options);
      projector.Pulse(options.max_on, [] { std::this_thread::sleep_for(std::chrono::minutes(2)); });
    } catch (const std::exception& error) {
      std::cerr << error.what() << '\n';
    }
    _exit(0);
  }
  ~PulsingProgram() { End(SIGKILL); }
  PulsingProgram(const PulsingProgram&) = delete;
  PulsingProgram& operator=(const PulsingProgram&) = delete;

  void Signal(int signal) const { kill(pid_, signal); }
  void End(int signal) {
    if (pid_ <= 0) return;
    kill(pid_, signal);
    waitpid(pid_, nullptr, 0);
    pid_ = 0;
  }

 private:
  pid_t pid_;
};

/// As long as the software allows, so that a program is surely caught lit.
ProjectorOptions LongPulse() {
  auto options = Rig();
  options.max_on = milliseconds(1000);
  return options;
}

TEST(ProjectorGpio, LineIsHighDuringThePulseOnly) {
  ProjectorGpio projector(Rig());
  EXPECT_EQ(Level(kLight), 0);
  int lit = -1;
  projector.Pulse(milliseconds(20), [&] { lit = Level(kLight); });
  EXPECT_EQ(lit, 1);
  EXPECT_EQ(Level(kLight), 0);
}

TEST(ProjectorGpio, ActiveLowLineIsLowDuringThePulseOnly) {
  auto options = Rig();
  options.active_low = true;
  ProjectorGpio projector(options);
  EXPECT_EQ(Level(kLight), 1);
  int lit = -1;
  projector.Pulse(milliseconds(20), [&] { lit = Level(kLight); });
  EXPECT_EQ(lit, 0);
  EXPECT_EQ(Level(kLight), 1);
}

TEST(ProjectorGpio, ChipIsFoundByLabelAndLineByName) {
  auto options = Rig();
  options.chip = "granary-rig";
  options.line = 0;
  options.line_name = "PROJECTOR";
  ProjectorGpio projector(options);
  int lit = -1;
  projector.Pulse(milliseconds(20), [&] { lit = Level(kLight); });
  EXPECT_EQ(lit, 1);
}

TEST(ProjectorGpio, TriggerLineRisesWhileTheLightIsOn) {
  auto options = Rig();
  options.trigger_line = kTrigger;
  ProjectorGpio projector(options);
  int light = -1;
  projector.Pulse(milliseconds(20), [&] { light = Level(kLight); });
  EXPECT_EQ(light, 1);
  EXPECT_EQ(Level(kTrigger), 0);
  EXPECT_EQ(Level(kLight), 0);
}

TEST(ProjectorGpio, LineIsLowAfterWhatLitThrew) {
  ProjectorGpio projector(Rig());
  EXPECT_THROW(projector.Pulse(milliseconds(20), [] { throw std::runtime_error("a camera"); }), std::runtime_error);
  EXPECT_EQ(Level(kLight), 0);
}

TEST(ProjectorGpio, GuardSwitchesOffWhileThePulseHangs) {
  auto options = Rig();
  options.max_on = milliseconds(50);
  ProjectorGpio projector(options);
  int after_the_guard = -1;
  const auto reason = ReasonOf([&] {
    projector.Pulse(milliseconds(20), [&] {
      EXPECT_EQ(Level(kLight), 1);
      WaitFor("the guard", [] { return Level(kLight) == 0; });
      after_the_guard = Level(kLight);
    });
    projector.Pulse(milliseconds(20));
  });
  EXPECT_EQ(after_the_guard, 0);
  EXPECT_EQ(reason, Reason::kProjectorGuard);
}

TEST(ProjectorGpio, LineIsLowAfterTheProgramIsKilled) {
  PulsingProgram program(LongPulse());
  WaitFor("the light", [] { return Level(kLight) == 1; });
  program.End(SIGKILL);
  EXPECT_EQ(Level(kLight), 0);
}

TEST(ProjectorGpio, LineIsLowAfterTheProgramIsTerminated) {
  PulsingProgram program(LongPulse());
  WaitFor("the light", [] { return Level(kLight) == 1; });
  program.End(SIGTERM);
  EXPECT_EQ(Level(kLight), 0);
}

// The limit of every guard in software, which the one-shot in hardware has to cover.
TEST(ProjectorGpio, StoppedProgramLeavesTheLightOnUntilItIsKilled) {
  PulsingProgram program(LongPulse());
  WaitFor("the light", [] { return Level(kLight) == 1; });
  program.Signal(SIGSTOP);
  std::this_thread::sleep_for(milliseconds(1500));
  EXPECT_EQ(Level(kLight), 1);
  program.End(SIGKILL);
  EXPECT_EQ(Level(kLight), 0);
}

TEST(ProjectorGpio, BusyLineIsNamedWithWhoHoldsIt) {
  const auto holder = OpenOutputLine({Rig().chip, kLight, "", false, "somebody-else"});
  try {
    ProjectorGpio projector(Rig());
    FAIL() << "took a line that is held";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.reason(), Reason::kProjectorFault);
    EXPECT_NE(std::string(error.what()).find("somebody-else"), std::string::npos) << error.what();
  }
}

TEST(ProjectorGpio, LineWorksWhenItsHolderHasGone) {
  OpenOutputLine({Rig().chip, kLight, "", false, "somebody-else"}).reset();
  ProjectorGpio projector(Rig());
  projector.Pulse(milliseconds(20));
}

TEST(ProjectorGpio, AbsentChipIsAFault) {
  auto options = Rig();
  options.chip = "/dev/gpiochip77";
  EXPECT_EQ(ReasonOf([&] { ProjectorGpio projector(options); }), Reason::kProjectorFault);
}

TEST(ProjectorGpio, AbsentLineIsAFault) {
  auto options = Rig();
  options.line = 100;
  EXPECT_EQ(ReasonOf([&] { ProjectorGpio projector(options); }), Reason::kProjectorFault);
}

TEST(ProjectorGpio, CyclesLeaveNothingBehind) {
  constexpr int kWarmUp = 20, kCycles = 400;
  Footprint before;
  for (int i = 0; i < kWarmUp + kCycles; ++i) {
    if (i == kWarmUp) before = FootprintNow();
    ProjectorGpio projector(Rig());
    projector.Pulse(milliseconds(2));
  }
  const Footprint after = FootprintNow();
  std::cout << kCycles << " cycles: before " << before << ", after " << after << '\n';
  EXPECT_EQ(after.descriptors, before.descriptors);
  // A guard that has been joined may still be counted for a moment.
  EXPECT_LE(after.threads, before.threads);
  EXPECT_LT(after.rss_kib, before.rss_kib + 512);
}

}  // namespace
}  // namespace granary
