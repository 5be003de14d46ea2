// Ports that are missing, taken, refuse their settings, or go away and come back.
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "daemon/modbus/serial_port.h"
#include "tests/daemon/modbus/rtu_line.h"

namespace granary::test {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;

constexpr RtuReopening kSoon{5ms, 20ms};

/// What the constructor says; empty when it says nothing.
std::string FaultOf(const ModbusRtuOptions& options) {
  RtuUnits bins;
  try {
    const RtuServer server(options, bins.units, bins.tally);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

/// A device path that stays while the line behind it goes and comes, as a USB adapter's does.
class PluggedLine {
 public:
  PluggedLine() { Plug(); }
  ~PluggedLine() { std::filesystem::remove(path_); }
  PluggedLine(const PluggedLine&) = delete;
  PluggedLine& operator=(const PluggedLine&) = delete;
  void Unplug() {
    std::filesystem::remove(path_);
    line_.reset();
  }
  void Plug() {
    line_ = std::make_unique<Pty>();
    std::filesystem::create_symlink(line_->Path(), path_);
  }
  [[nodiscard]] const std::string& Path() const { return path_; }
  [[nodiscard]] const Pty& Line() const { return *line_; }

 private:
  const std::string path_ =
      (std::filesystem::temp_directory_path() / ("granary-rtu-" + std::to_string(getpid()))).string();
  std::unique_ptr<Pty> line_;
};

/// Asks until there is an answer: the server opens the port when it gets to it.
bool IsAnsweredInTheEnd(const Pty& line) {
  for (int tries = 0; tries < 400; ++tries) {
    line.Send(ReadRequest(kUs, 5));
    pollfd ready{line.Descriptor(), POLLIN, 0};
    if (poll(&ready, 1, 50) == 1) return line.ReceiveSome().size() > 0;
  }
  return false;
}

TEST(RtuServer, NamesAMissingDevice) {
  EXPECT_THAT(FaultOf(OptionsFor("/dev/no-such-port")),
              AllOf(HasSubstr("/dev/no-such-port"), HasSubstr("No such file or directory")));
}

TEST(RtuServer, NamesADeviceThatIsNoSerialPort) {
  EXPECT_THAT(FaultOf(OptionsFor("/dev/null")), AllOf(HasSubstr("/dev/null"), HasSubstr("is no serial port")));
}

TEST(RtuServer, NamesADeviceThatAnotherHolds) {
  const Pty line;
  RtuUnits bins;
  const RtuServer first(OptionsFor(line.Path()), bins.units, bins.tally);
  EXPECT_THAT(FaultOf(OptionsFor(line.Path())), AllOf(HasSubstr(line.Path()), HasSubstr("another program holds it")));
}

TEST(RtuServer, LeavesTheDeviceToTheNext) {
  const Pty line;
  EXPECT_EQ(FaultOf(OptionsFor(line.Path())), "");
  EXPECT_EQ(FaultOf(OptionsFor(line.Path())), "");
}

TEST(RtuServer, NamesTheKeyWhenTheDriverHasNoDirectionControl) {
  const Pty line;
  ModbusRtuOptions options = OptionsFor(line.Path());
  options.rs485 = true;
  EXPECT_THAT(FaultOf(options), AllOf(HasSubstr(line.Path()), HasSubstr("rs485")));
}

TEST(RtuServer, NamesASpeedThatNoPortHas) {
  const Pty line;
  ModbusRtuOptions options = OptionsFor(line.Path());
  options.baud = 12345;
  EXPECT_THAT(FaultOf(options), AllOf(HasSubstr("12345 baud"), HasSubstr("115200")));
}

TEST(RtuServer, RefusesAUnitThatIsNoBin) {
  const Pty line;
  RtuUnits bins;
  ModbusRtuOptions options = OptionsFor(line.Path());
  for (const int unit : {0, 9, 255, 259}) {
    options.units = {3, unit};
    EXPECT_THROW(const RtuServer server(options, bins.units, bins.tally), std::invalid_argument) << unit;
  }
}

TEST(RtuServer, WaitsForAMissingDeviceWhenToldTo) {
  PluggedLine plugged;
  plugged.Unplug();
  RtuUnits bins;
  const RtuServer server(OptionsFor(plugged.Path()), bins.units, bins.tally, {5ms, 20ms, true});
  plugged.Plug();
  EXPECT_TRUE(IsAnsweredInTheEnd(plugged.Line()));
}

TEST(RtuServer, ComesBackWithItsPort) {
  PluggedLine plugged;
  RtuUnits bins;
  const RtuServer server(OptionsFor(plugged.Path()), bins.units, bins.tally, kSoon);
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(IsAnsweredInTheEnd(plugged.Line()));
    plugged.Unplug();
    std::this_thread::sleep_for(20ms);  // a few of its attempts fail
    plugged.Plug();
  }
  EXPECT_TRUE(IsAnsweredInTheEnd(plugged.Line()));
}

TEST(RtuServer, ComesBackFromADeviceThatCannotBeUsed) {
  PluggedLine plugged;
  RtuUnits bins;
  const RtuServer server(OptionsFor(plugged.Path()), bins.units, bins.tally, kSoon);
  plugged.Unplug();
  std::filesystem::create_symlink("/dev/null", plugged.Path());
  std::this_thread::sleep_for(20ms);
  std::filesystem::remove(plugged.Path());
  plugged.Plug();
  EXPECT_TRUE(IsAnsweredInTheEnd(plugged.Line()));
}

TEST(RtuServer, StopsAtOnceWhileItsPortIsAway) {
  PluggedLine plugged;
  RtuUnits bins;
  std::optional<RtuServer> server;
  server.emplace(OptionsFor(plugged.Path()), bins.units, bins.tally, RtuReopening{std::chrono::hours{1}, {}});
  plugged.Unplug();
  std::this_thread::sleep_for(20ms);
  server.reset();  // would hang for an hour
}

TEST(RtuServer, OutlivesAMasterThatTakesNoAnswers) {
  const Pty line;
  RtuUnits bins;
  const RtuServer server(OptionsFor(line.Path()), bins.units, bins.tally, kSoon);
  // Until the line is full; then for longer than the server waits for room, so that it opens the port again.
  for (bool goes_on = true; goes_on;) {
    const auto before = bins.Counters().rtu_requests;
    line.Send(ReadRequest(kUs, 0, 125));
    for (int i = 0; i < 1200 && bins.Counters().rtu_requests == before; ++i) std::this_thread::sleep_for(1ms);
    goes_on = bins.Counters().rtu_requests != before;
  }
  while (!line.IsSilent()) static_cast<void>(line.ReceiveSome());
  EXPECT_TRUE(IsAnsweredInTheEnd(line));
}

// A driver with direction control is no part of this machine: what would be asked of it, and what it may refuse.

TEST(Rs485Of, AsksForThePolarityAndTheDelays) {
  ModbusRtuOptions options;
  options.rts_before = 2ms;
  options.rts_after = 3ms;
  EXPECT_EQ(Rs485Of(options).flags, std::uint32_t{SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND});
  EXPECT_EQ(Rs485Of(options).delay_rts_before_send, 2U);
  EXPECT_EQ(Rs485Of(options).delay_rts_after_send, 3U);
  options.rts_on_send = false;
  EXPECT_EQ(Rs485Of(options).flags, std::uint32_t{SER_RS485_ENABLED | SER_RS485_RTS_AFTER_SEND});
}

TEST(Rs485Refused, NamesTheKeyThatTheDriverChanged) {
  ModbusRtuOptions options;
  options.rts_before = 2ms;
  options.rts_after = 3ms;
  const serial_rs485 asked = Rs485Of(options);
  EXPECT_EQ(Rs485Refused(asked, asked), "");
  serial_rs485 taken = asked;
  taken.flags = 0;
  EXPECT_EQ(Rs485Refused(asked, taken), "rs485 = true");
  taken.flags = SER_RS485_ENABLED | SER_RS485_RTS_AFTER_SEND;
  EXPECT_EQ(Rs485Refused(asked, taken), "rts_on_send = true");
  taken = asked;
  taken.delay_rts_before_send = 0;
  EXPECT_EQ(Rs485Refused(asked, taken), "rts_before, it has 0 ms");
  taken = asked;
  taken.delay_rts_after_send = 0;
  EXPECT_EQ(Rs485Refused(asked, taken), "rts_after, it has 0 ms");
}

}  // namespace
}  // namespace granary::test
