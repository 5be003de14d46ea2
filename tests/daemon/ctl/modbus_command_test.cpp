// The built program against a server in this process, and against none.
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/ctl/run_program.h"
#include "tests/daemon/modbus/served.h"

namespace granary {
namespace {

using test::GoodSnapshot;
using test::HeldSnapshot;
using test::Served;
using testing::AllOf;
using testing::HasSubstr;

std::string Target(const Served& served, int unit = 3) {
  return " --address 127.0.0.1:" + std::to_string(served.Port()) + " --unit " + std::to_string(unit) + " ";
}

/// A port that nobody listens on: taken and given back.
std::string FreePort() {
  const FileDescriptor listener = ListenTcp("127.0.0.1", 0);
  return std::to_string(BoundPort(listener.Get()));
}

TEST(ModbusPoll, ShowsNamesValuesAndUnits) {
  const CtlFolder folder;
  const Served served;
  const ProgramRun run = folder.Run("modbus poll" + Target(served));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out, "");
  EXPECT_THAT(run.err, AllOf(HasSubstr("volume                  19.5            m³"), HasSubstr("status   valid"),
                             HasSubstr("class    0 ok"), HasSubstr("measured_at")));
}
TEST(ModbusPoll, JsonHoldsEveryBlockWithNulls) {
  const CtlFolder folder;
  const Served served;
  const ProgramRun run = folder.Run("modbus poll --json --block all" + Target(served));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const auto document = run.Document();
  EXPECT_EQ(document.at("unit"), 3);
  EXPECT_EQ(document.at("reason"), "ok");
  EXPECT_EQ(document.at("status"), nlohmann::json::array({"valid"}));
  EXPECT_TRUE(document.at("one_snapshot"));
  const auto& values = document.at("values");
  EXPECT_EQ(values.at("volume"), 19.5);
  EXPECT_EQ(values.at("volume_i32"), 19500);
  EXPECT_EQ(values.at("rm5708_tag"), 3);
  EXPECT_EQ(values.at("site"), "depot-7");
  EXPECT_EQ(values.at("byte_order"), 0);
  EXPECT_TRUE(values.at("rig_temperature").is_null());
}
TEST(ModbusPoll, ObeysTheByteOrderInForce) {
  const CtlFolder folder;
  Served served;
  BinSnapshot snapshot = GoodSnapshot();
  snapshot.format.byte_order = ByteOrder::kDcba;
  served.units.Publish(snapshot);
  const auto document = folder.Run("modbus poll --json" + Target(served)).Document();
  EXPECT_EQ(document.at("byte_order"), "DCBA");
  EXPECT_EQ(document.at("values").at("volume"), 19.5);
}
TEST(ModbusPoll, HeldFiguresAreSaidToBeHeld) {
  const CtlFolder folder;
  Served served;
  served.units.Publish(HeldSnapshot(Reason::kProjectorDark));
  const ProgramRun run = folder.Run("modbus poll" + Target(served));
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_THAT(run.err, AllOf(HasSubstr("held"), HasSubstr("21 projector_dark"), HasSubstr("current  none")));
}
TEST(ModbusPoll, CheckFailsWhileTheHeartbeatStandsStill) {
  const CtlFolder folder;
  const Served served;
  const ProgramRun run = folder.Run("modbus poll --check --json" + Target(served));
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("STANDS STILL"));
  EXPECT_FALSE(run.Document().at("heartbeat_counts"));
}
TEST(ModbusPoll, CheckPassesWhileTheHeartbeatCounts) {
  const CtlFolder folder;
  Served served;
  const std::jthread worker([&](const std::stop_token& stop) {
    for (BinSnapshot snapshot = GoodSnapshot(); !stop.stop_requested(); ++snapshot.heartbeat) {
      served.units.Publish(snapshot);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const ProgramRun run = folder.Run("modbus poll --check" + Target(served));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("the heartbeat counts"));
}
TEST(ModbusPoll, NobodyListeningNamesAddressAndKey) {
  const CtlFolder folder;
  const std::string port = FreePort();
  const ProgramRun run = folder.Run("modbus poll --json --unit 1 --address 127.0.0.1:" + port);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Document().value("error", ""),
              AllOf(HasSubstr("no Modbus server listens on 127.0.0.1:" + port), HasSubstr("--address")));
}
TEST(ModbusPoll, UnknownUnitNamesTheException) {
  const CtlFolder folder;
  const Served served;
  const ProgramRun run = folder.Run("modbus poll --json" + Target(served, 9));
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Document().value("error", ""), AllOf(HasSubstr("0B"), HasSubstr("unit id 9")));
}
TEST(ModbusPoll, UnknownHostIsNamed) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run("modbus poll --json --unit 1 --address no-such-host.invalid:502");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Document().value("error", ""), HasSubstr("no-such-host.invalid"));
}
TEST(ModbusPoll, RefusedAddressPointsToTheAllowList) {
  const CtlFolder folder;
  ModbusTcpOptions options;
  options.allow = {"192.0.2.0/24"};
  const Served served({}, options);
  const ProgramRun run = folder.Run("modbus poll --json" + Target(served));
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Document().value("error", ""), HasSubstr("modbus.tcp.allow"));
}
TEST(ModbusPoll, BadArgumentsAreBadUsage) {
  const CtlFolder folder;
  for (const char* arguments :
       {"modbus", "modbus poll --address nonsense --unit 1", "modbus poll --unit 300", "modbus poll --block mirrors",
        "modbus watch --every 0", "modbus inject", "modbus inject --end --volume 3",
        "modbus inject --volume 3 --for never", "alarm", "modbus watch --json --unit 1 --address 127.0.0.1:9"}) {
    const ProgramRun run = folder.Run(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments << "\n" << run.err;
  }
}
TEST(ModbusPoll, AddressComesFromTheConfiguration) {
  const CtlFolder folder;
  folder.Write("none.toml", "[modbus.tcp]\nlisten = \"0.0.0.0:1\"\n");
  const ProgramRun run = folder.Run("-c none.toml modbus poll --json");
  EXPECT_EQ(run.exit_code, 1);  // the file has no bin, and is read whole or not at all
  EXPECT_THAT(run.Document().value("error", ""), HasSubstr("none.toml"));
}

TEST(ModbusWatch, PrintsOneLineAChange) {
  const CtlFolder folder;
  const Served served;
  const ProgramRun run = folder.Run("modbus watch --json --every 0.05 --count 4" + Target(served));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const auto lines = run.Document();
  ASSERT_EQ(lines.size(), 1U) << run.out;
  EXPECT_THAT(lines[0].at("line").get<std::string>(), HasSubstr("sequence 17  19.5 m3"));
}
TEST(ModbusWatch, GoesOnWhenTheServerComesBack) {
  const CtlFolder folder;
  test::RecordingControl control;
  ModbusTally tally;
  ModbusUnits units(test::kIdentity, {GoodSnapshot().bin}, control, tally);
  units.Publish(GoodSnapshot());
  auto server = std::make_unique<ModbusServer>(ListenTcp("127.0.0.1", 0), ModbusTcpOptions{}, units, tally);
  const std::uint16_t port = server->Port();
  std::jthread restart([&] {
    while (tally.requests < 8) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    server.reset();
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    server = std::make_unique<ModbusServer>(ListenTcp("127.0.0.1", port), ModbusTcpOptions{}, units, tally);
  });
  const ProgramRun run =
      folder.Run("modbus watch --every 0.05 --count 60 --unit 3 --address 127.0.0.1:" + std::to_string(port));
  restart.join();
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, AllOf(HasSubstr("lost: "), HasSubstr("the server answers again")));
}

TEST(ModbusInject, WithoutADaemonSaysSo) {
  const CtlFolder folder;
  const ProgramRun run =
      folder.Run("modbus inject --volume 12 --json", "RUNTIME_DIRECTORY='" + folder.path().string() + "'");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.Document().value("error", ""), "");
}

}  // namespace
}  // namespace granary
