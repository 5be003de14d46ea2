#include "daemon/control_socket.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "daemon/local_commands.h"
#include "tests/daemon/depot.h"

namespace granary {
namespace {

using Json = nlohmann::json;

Json Echo(const Json& request, const std::string& who) { return {{"ok", true}, {"request", request}, {"who", who}}; }

FileDescriptor Connect(const std::filesystem::path& folder) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, (folder / "control.sock").c_str(), sizeof address.sun_path - 1);
  FileDescriptor socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (connect(socket.Get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return {};
  return socket;
}

void Send(const FileDescriptor& socket, const std::string& text) {
  EXPECT_EQ(send(socket.Get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
}

/// All that comes until the other side hangs up.
std::string ReadAll(const FileDescriptor& socket) {
  std::string text;
  char bytes[1024];
  for (ssize_t count = 0; (count = recv(socket.Get(), bytes, sizeof bytes, 0)) > 0;) {
    text.append(bytes, static_cast<std::size_t>(count));
  }
  return text;
}

std::string ErrorOf(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(ControlSocket, AnswersAndKnowsWhoAsks) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  const Json answer = AskDaemon(folder.path(), {{"command", "status"}});
  EXPECT_EQ(answer["request"]["command"], "status");
  EXPECT_EQ(answer["who"], "local uid " + std::to_string(getuid()));
}

TEST(ControlSocket, IsForOwnerAndGroup) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  struct stat status {};
  ASSERT_EQ(stat((folder / "control.sock").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0660U);
}

TEST(ControlSocket, AnswersSeveralClientsWhileOneDawdles) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  const FileDescriptor slow = Connect(folder.path());
  Send(slow, "{\"comm");
  for (int i = 0; i < 40; ++i) EXPECT_TRUE(AskDaemon(folder.path(), {{"n", i}})["ok"]);
  Send(slow, "and\":1}\n");
  shutdown(slow.Get(), SHUT_WR);
  EXPECT_NE(ReadAll(slow).find("\"ok\":true"), std::string::npos);
}

TEST(ControlSocket, DropsWhoNeverEndsALine) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  const FileDescriptor slow = Connect(folder.path());
  Send(slow, "{");
  EXPECT_EQ(ReadAll(slow), "");
}

TEST(ControlSocket, RefusesALineThatIsTooLong) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  const FileDescriptor client = Connect(folder.path());
  Send(client, std::string(4097, ' '));
  EXPECT_NE(ReadAll(client).find("too long"), std::string::npos);
}

TEST(ControlSocket, SaysThatALineIsNoJson) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  const FileDescriptor client = Connect(folder.path());
  Send(client, "hello\n" + std::string(4000, '[') + "\n");
  shutdown(client.Get(), SHUT_WR);
  EXPECT_NE(ReadAll(client).find("not one JSON object a line"), std::string::npos);
}

TEST(ControlSocket, OutlivesAHandlerThatThrows) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(),
                             [](const Json&, const std::string&) -> Json { throw std::logic_error("bug"); });
  EXPECT_EQ(AskDaemon(folder.path(), {})["error"], "internal: bug");
  EXPECT_EQ(AskDaemon(folder.path(), {})["error"], "internal: bug");
}

TEST(ControlSocket, MakesRoomForTheNewest) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  std::vector<FileDescriptor> idle;
  for (int i = 0; i < 100; ++i) idle.push_back(Connect(folder.path()));
  EXPECT_TRUE(AskDaemon(folder.path(), {{"n", 1}})["ok"]);
}

TEST(ControlSocket, LeavesALivingDaemonsSocketAlone) {
  TemporaryFolder folder;
  const ControlSocket socket(folder.path(), Echo);
  const std::string error = ErrorOf([&] { const ControlSocket second(folder.path(), Echo); });
  EXPECT_NE(error.find("another granaryd listens there"), std::string::npos) << error;
  EXPECT_TRUE(AskDaemon(folder.path(), {{"n", 1}})["ok"]);
}

TEST(ControlSocket, ReplacesWhatAKilledDaemonLeft) {
  TemporaryFolder folder;
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const auto* left = new ControlSocket(folder.path(), Echo);  // never destroyed
    _exit(left == nullptr ? 1 : 0);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(std::filesystem::exists(folder / "control.sock"));
  const ControlSocket socket(folder.path(), Echo);
  EXPECT_TRUE(AskDaemon(folder.path(), {{"n", 1}})["ok"]);
}

TEST(ControlSocket, NamesAFolderThatIsTooLong) {
  TemporaryFolder folder;
  const auto deep = folder / std::string(120, 'x');
  EXPECT_NE(ErrorOf([&] { const ControlSocket socket(deep, Echo); }).find("at most 107"), std::string::npos);
}

TEST(ControlFolder, IsWhereSystemdSays) {
  setenv("RUNTIME_DIRECTORY", "/run/one:/run/two", 1);
  EXPECT_EQ(ControlFolder("/state"), "/run/one");
  unsetenv("RUNTIME_DIRECTORY");
  EXPECT_EQ(ControlFolder("/state"), "/state");
}

TEST(AskDaemon, SaysWhereItLookedForADaemon) {
  TemporaryFolder folder;
  const std::string error = ErrorOf([&] { static_cast<void>(AskDaemon(folder.path(), {})); });
  EXPECT_NE(error.find((folder / "control.sock").string()), std::string::npos) << error;
  EXPECT_NE(error.find("is granaryd running"), std::string::npos) << error;
}

Json Ask(BinMonitor& bin, const Json& request) { return AnswerLocal(request, "local uid 7", {&bin}); }

TEST(AnswerLocal, InjectsAndEndsIt) {
  Depot depot;
  auto monitor = depot.Monitor();
  const Json answer = Ask(*monitor, {{"command", "inject"}, {"bin", 3}, {"seconds", 60}, {"volume_m3", 0.5}});
  EXPECT_EQ(answer["ok"], true) << answer;
  EXPECT_EQ(answer["injected"], true);
  EXPECT_EQ(monitor->Published().good->volume_m3, 0.5);
  EXPECT_EQ(Ask(*monitor, {{"command", "inject"}, {"bin", 3}, {"seconds", 0}})["injected"], false);
}

TEST(AnswerLocal, TellsTheStateOfTheBin) {
  Depot depot;
  auto monitor = depot.Monitor();
  const Json answer = Ask(*monitor, {{"command", "inhibit"}});
  EXPECT_EQ(answer["ok"], true) << answer;
  EXPECT_EQ(answer["maintenance"], true);
  EXPECT_EQ(answer["command"], "inhibit");
  EXPECT_EQ(answer["book"]["book_mass_kg"], 800);
  EXPECT_TRUE(monitor->RestIfInhibited());
  ASSERT_TRUE(depot.publisher.Await(Came(BinCommand::kInhibit, CommandResult::kDone)));
  EXPECT_EQ(Ask(*monitor, {{"command", "status"}})["result"], "done");
  EXPECT_EQ(Ask(*monitor, {{"command", "measure"}})["error"],
            "bin 3: measure is rejected: the bin is inhibited; release it first");
}

TEST(AnswerLocal, SaysThatACommandIsBusy) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_EQ(Ask(*monitor, {{"command", "measure"}})["result"], "busy");
  EXPECT_EQ(Ask(*monitor, {{"command", "inhibit"}})["error"], "bin 3: not now: measure is still busy");
}

TEST(AnswerLocal, NamesWhatIsWrongAndAllowed) {
  Depot depot;
  auto monitor = depot.Monitor();
  const auto error = [&](const Json& request) { return Ask(*monitor, request)["error"].get<std::string>(); };
  EXPECT_EQ(error(Json::array()), "the request must be a JSON object");
  EXPECT_EQ(error({{"command", "sing"}}),
            "command: is \"sing\", must be inject, measure, acknowledge, inhibit, release or status");
  EXPECT_EQ(error({{"bin", 3}}),
            "command: is missing, must be inject, measure, acknowledge, inhibit, release or status");
  EXPECT_EQ(error({{"command", "status"}, {"bin", 4}}), "bin: is 4, must be one of 3");
  EXPECT_EQ(error({{"command", "measure"}, {"volume", 4}}), "volume: is unknown; allowed are command, bin");
  EXPECT_EQ(error({{"command", "inject"}, {"seconds", 60}, {"volume_m3", "much"}}),
            "volume_m3: is \"much\", must be a number");
  EXPECT_EQ(error({{"command", "inject"}, {"seconds", 60}, {"volume_m3", -1}}), "volume_m3: must be 0 to 1000000");
  EXPECT_NE(error({{"command", "inject"}, {"volume_m3", 1}}).find("seconds: is missing"), std::string::npos);
  EXPECT_NE(error({{"command", "inject"}, {"seconds", 60}, {"reason", "tired"}}).find("frame_missing"),
            std::string::npos);
}

TEST(AnswerLocal, WantsABinWhereThereAreSeveral) {
  Depot depot;
  auto monitor = depot.Monitor();
  const Json answer = AnswerLocal({{"command", "status"}}, "tester", {monitor.get(), monitor.get()});
  EXPECT_EQ(answer["error"], "bin: is missing, must be one of 3, 3");
}

}  // namespace
}  // namespace granary
