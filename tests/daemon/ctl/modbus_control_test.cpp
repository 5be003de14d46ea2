// The built program against a local socket whose other end is in this process.
#include <algorithm>
#include <mutex>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "daemon/control_socket.h"
#include "tests/daemon/ctl/run_program.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// A daemon that answers each request as it is told to, and remembers it.
class Daemon {
 public:
  /// @param answers one after the other, the last one for ever
  template <typename... Answers>
  explicit Daemon(const Answers&... answers)
      : answers_{answers...},
        socket_(folder_.path(), [this](const nlohmann::json& request, const std::string&) { return Next(request); }) {}

  [[nodiscard]] ProgramRun Run(const std::string& arguments) const {
    return folder_.Run(arguments, "RUNTIME_DIRECTORY='" + folder_.path().string() + "'");
  }
  [[nodiscard]] std::vector<nlohmann::json> requests() const {
    const std::scoped_lock lock(mutex_);
    return requests_;
  }

 private:
  nlohmann::json Next(const nlohmann::json& request) {
    const std::scoped_lock lock(mutex_);
    requests_.push_back(request);
    return answers_.at(std::min(requests_.size(), answers_.size()) - 1);
  }

  mutable std::mutex mutex_;
  const std::vector<nlohmann::json> answers_;
  std::vector<nlohmann::json> requests_;
  CtlFolder folder_;
  ControlSocket socket_;
};

const nlohmann::json kDone{{"ok", true}};

nlohmann::json State(const char* command, const char* result) {
  return {{"ok", true}, {"command", command}, {"result", result}};
}

TEST(ModbusInject, SendsWhatWasGivenAndNothingElse) {
  const Daemon daemon(kDone);
  const ProgramRun run = daemon.Run("modbus inject --bin 2 --volume 12.5 --error-rate -3.5 --for 2min");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(
      daemon.requests().at(0),
      nlohmann::json(
          {{"command", "inject"}, {"bin", 2}, {"seconds", 120}, {"volume_m3", 12.5}, {"error_rate_percent", -3.5}}));
}
TEST(ModbusInject, SaysUntilWhenHowItIsMarkedAndHowToEndIt) {
  const Daemon daemon(kDone);
  const ProgramRun run = daemon.Run("modbus inject --reason frame_missing");
  EXPECT_THAT(run.err, AllOf(HasSubstr("until 20"), HasSubstr("simulated"), HasSubstr("modbus inject --end")));
}
TEST(ModbusInject, EndIsZeroSeconds) {
  const Daemon daemon(kDone);
  EXPECT_EQ(daemon.Run("modbus inject --end").exit_code, 0);
  EXPECT_EQ(daemon.requests().at(0), nlohmann::json({{"command", "inject"}, {"seconds", 0}}));
}
TEST(ModbusInject, DaemonsRefusalIsTheError) {
  const Daemon daemon(nlohmann::json{{"error", "volume_m3: must be 0 to 50"}});
  const ProgramRun run = daemon.Run("modbus inject --json --volume 51");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.Document().value("error", ""), "volume_m3: must be 0 to 50");
}

TEST(AlarmAck, AsksToAcknowledge) {
  const Daemon daemon(State("none", "idle"), State("acknowledge", "done"));
  const ProgramRun run = daemon.Run("alarm ack --json");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.Document().value("result", ""), "done");
  EXPECT_EQ(daemon.requests().at(1), nlohmann::json({{"command", "acknowledge"}}));
}
TEST(Inhibit, WaitsUntilTheBinRests) {
  const Daemon daemon(State("none", "idle"), State("inhibit", "busy"), State("inhibit", "busy"),
                      State("inhibit", "done"));
  const ProgramRun run = daemon.Run("inhibit --bin 1");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("inhibited, bin 1"));
  ASSERT_EQ(daemon.requests().size(), 4U);
  EXPECT_EQ(daemon.requests().at(3), nlohmann::json({{"command", "status"}, {"bin", 1}}));
}
TEST(Inhibit, WaitsForTheCommandBefore) {
  const Daemon daemon(State("measure", "busy"), State("measure", "done"), State("inhibit", "done"));
  const ProgramRun run = daemon.Run("inhibit");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("waiting for measure"));
  EXPECT_EQ(daemon.requests().at(2), nlohmann::json({{"command", "inhibit"}}));
}
TEST(Inhibit, RejectedIsAFailure) {
  const Daemon daemon(State("none", "idle"), State("inhibit", "busy"), State("inhibit", "rejected"));
  EXPECT_EQ(daemon.Run("inhibit").exit_code, 1);
}
TEST(Inhibit, AnotherCommandInBetweenIsAFailure) {
  const Daemon daemon(State("none", "idle"), State("inhibit", "busy"), State("release", "done"));
  const ProgramRun run = daemon.Run("inhibit --json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Document().value("error", ""), HasSubstr("release"));
}
TEST(Release, AsksToRelease) {
  const Daemon daemon(State("none", "idle"), State("release", "done"));
  EXPECT_EQ(daemon.Run("release").exit_code, 0);
  EXPECT_EQ(daemon.requests().at(1), nlohmann::json({{"command", "release"}}));
}

}  // namespace
}  // namespace granary
