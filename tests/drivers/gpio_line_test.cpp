#include "drivers/gpio_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <thread>

#include "drivers/errors.h"
#include "drivers/projector_gpio.h"
#include "tests/drivers/gpio/fake_chips.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

/// Two chips: of four lines and of two.
class OpenOutputLineTest : public testing::Test {
 protected:
  OpenOutputLineTest() {
    Kernel() = {};
    FakeChip& soc = Kernel().chips["gpiochip0"];
    soc.label = "pinctrl-soc";
    soc.lines.resize(4);
    soc.lines[1].name = "PROJECTOR";
    soc.lines[2].name = soc.lines[3].name = "SPARE";
    FakeChip& expander = Kernel().chips["gpiochip1"];
    expander.label = "expander";
    expander.lines.resize(2);
    for (const auto& [name, chip] : Kernel().chips) (void)devices_.Write(name, "");
  }
  ~OpenOutputLineTest() override { EXPECT_EQ(Kernel().open_handles, 0); }

  std::unique_ptr<OutputLine> Open(const LineRequest& request) { return OpenOutputLine(request, devices_.path()); }
  std::string Refusal(const LineRequest& request) {
    try {
      (void)Open(request);
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.reason(), Reason::kProjectorFault);
      return error.what();
    }
    return "nothing was refused";
  }
  static FakeChipLine& Line(const std::string& chip, unsigned offset) {
    return Kernel().chips.at(chip).lines.at(offset);
  }

  TemporaryFolder devices_;
};

TEST_F(OpenOutputLineTest, FindsTheChipByItsFile) {
  const auto line = Open({.chip = (devices_ / "gpiochip1").string(), .offset = 1});
  EXPECT_TRUE(Line("gpiochip1", 1).used);
}

TEST_F(OpenOutputLineTest, FindsTheChipByItsName) {
  const auto line = Open({.chip = "gpiochip1", .offset = 1});
  EXPECT_TRUE(Line("gpiochip1", 1).used);
}

TEST_F(OpenOutputLineTest, FindsTheChipByItsLabel) {
  const auto line = Open({.chip = "expander", .offset = 1});
  EXPECT_TRUE(Line("gpiochip1", 1).used);
}

TEST_F(OpenOutputLineTest, FindsTheLineByItsName) {
  const auto line = Open({.chip = "pinctrl-soc", .name = "PROJECTOR"});
  EXPECT_TRUE(Line("gpiochip0", 1).used);
}

TEST_F(OpenOutputLineTest, IsInactiveFromTheRequestOn) {
  const auto line = Open({.chip = "gpiochip0", .offset = 1});
  EXPECT_THAT(Line("gpiochip0", 1).levels, ElementsAre(0));
}

TEST_F(OpenOutputLineTest, IsHighWhileInactiveWhenActiveLow) {
  const auto line = Open({.chip = "gpiochip0", .offset = 1, .active_low = true});
  line->Set(true);
  EXPECT_THAT(Line("gpiochip0", 1).levels, ElementsAre(1, 0));
}

TEST_F(OpenOutputLineTest, IsInactiveBeforeItIsReleased) {
  Open({.chip = "gpiochip0", .offset = 1})->Set(true);
  EXPECT_THAT(Line("gpiochip0", 1).levels, ElementsAre(0, 1, 0));
  EXPECT_FALSE(Line("gpiochip0", 1).used);
}

TEST_F(OpenOutputLineTest, TellsItsConsumer) {
  const auto line = Open({.chip = "gpiochip0", .offset = 1, .consumer = "granaryd trigger"});
  EXPECT_EQ(Line("gpiochip0", 1).consumer, "granaryd trigger");
}

TEST_F(OpenOutputLineTest, NamesWhoHoldsABusyLine) {
  Line("gpiochip0", 1).used = true;
  Line("gpiochip0", 1).consumer = "fan-control";
  EXPECT_THAT(Refusal({.chip = "gpiochip0", .offset = 1}),
              AllOf(HasSubstr("gpiochip0 line 1"), HasSubstr("busy"), HasSubstr("\"fan-control\"")));
}

TEST_F(OpenOutputLineTest, SaysThatABusyLineHasNoNamedHolder) {
  Line("gpiochip0", 1).used = true;
  EXPECT_THAT(Refusal({.chip = "gpiochip0", .offset = 1}), HasSubstr("the kernel or a program without a name"));
}

TEST_F(OpenOutputLineTest, ListsTheChipsWhereOneIsAbsent) {
  EXPECT_THAT(Refusal({.chip = "gpiochip7", .offset = 1}),
              AllOf(HasSubstr("gpiochip7 line 1"), HasSubstr("gpiochip0 [pinctrl-soc] of 4 lines"),
                    HasSubstr("gpiochip1 [expander] of 2 lines")));
  EXPECT_THAT(Refusal({.chip = (devices_ / "gpiochip7").string(), .offset = 1}), HasSubstr("gpiochip1 [expander]"));
}

TEST_F(OpenOutputLineTest, SaysThatThereIsNoChipAtAll) {
  std::filesystem::remove(devices_ / "gpiochip0");
  std::filesystem::remove(devices_ / "gpiochip1");
  EXPECT_THAT(Refusal({.chip = "expander", .offset = 1}), HasSubstr("there is none at all"));
}

TEST_F(OpenOutputLineTest, RefusesALabelOfTwoChips) {
  Kernel().chips.at("gpiochip0").label = "expander";
  EXPECT_THAT(Refusal({.chip = "expander", .offset = 1}), AllOf(HasSubstr("gpiochip0"), HasSubstr("gpiochip1")));
}

TEST_F(OpenOutputLineTest, SaysHowManyLinesTheChipHas) {
  EXPECT_THAT(Refusal({.chip = "gpiochip0", .offset = 4}), HasSubstr("4 lines, allowed is 0 to 3"));
}

TEST_F(OpenOutputLineTest, RefusesANameThatOccursTwice) {
  EXPECT_THAT(Refusal({.chip = "gpiochip0", .name = "SPARE"}), HasSubstr("give the offset of one: 2, 3"));
}

TEST_F(OpenOutputLineTest, RefusesANameThatDoesNotOccur) {
  EXPECT_THAT(Refusal({.chip = "gpiochip0", .name = "LAMP"}), HasSubstr("no line of this name"));
}

TEST_F(OpenOutputLineTest, SaysWhoMayOpenTheChip) {
  Kernel().chips.at("gpiochip1").open_error = EACCES;
  EXPECT_THAT(Refusal({.chip = "gpiochip1", .offset = 1}), AllOf(HasSubstr("Permission denied"), HasSubstr("group")));
  EXPECT_THAT(Refusal({.chip = "expander", .offset = 1}), AllOf(HasSubstr("Permission denied"), HasSubstr("group")));
}

TEST_F(OpenOutputLineTest, ThrowsWhenTheLineCannotBeSet) {
  const auto line = Open({.chip = "gpiochip0", .offset = 1});
  Kernel().set_error = EREMOTEIO;
  EXPECT_THROW(line->Set(true), DeviceError);
  Kernel().set_error = 0;
}

std::ptrdiff_t EntriesOf(const std::string& folder) {
  const std::filesystem::directory_iterator entries(folder);
  return std::distance(begin(entries), end(entries));
}

[[maybe_unused]] double Resident_mib() {
  double size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return resident * 4096 / 1048576;
}

TEST_F(OpenOutputLineTest, TenThousandOpenPulseCloseLeaveNothingBehind) {
  ProjectorOptions options;
  options.driver = ProjectorDriver::kGpio;
  options.chip = (devices_ / "gpiochip0").string();
  options.line = 0;
  options.trigger_line = 1;
  options.settle = 0us;
  options.max_on = 1000ms;
  options.max_duty_percent = 100;
  const auto cycles = [&](int count) {
    for (int i = 0; i < count; ++i) {
      ProjectorGpio(options).Pulse(1us);
      for (unsigned line : {0U, 1U}) Line("gpiochip0", line).levels.clear();
    }
  };
  cycles(100);
  const auto files = EntriesOf("/proc/self/fd"), threads = EntriesOf("/proc/self/task");
  [[maybe_unused]] const double resident_mib = Resident_mib();
  cycles(10'000);
  EXPECT_EQ(EntriesOf("/proc/self/fd"), files);
  // A thread that has been joined may still be on its way out of the kernel's table.
  for (int i = 0; i < 1000 && EntriesOf("/proc/self/task") > threads; ++i) std::this_thread::yield();
  EXPECT_LE(EntriesOf("/proc/self/task"), threads);
  EXPECT_EQ(Kernel().open_handles, 0);
#ifndef __SANITIZE_ADDRESS__  // which holds on to what was freed
  // The account of the lit time keeps the pulses of ten seconds, 16 bytes each.
  EXPECT_LT(Resident_mib() - resident_mib, 2);
#endif
}

}  // namespace
}  // namespace granary
