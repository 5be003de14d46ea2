// Many connections at once: none leaks a descriptor, and who was there before is served meanwhile.
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <sys/resource.h>

#include "daemon/modbus/server.h"
#include "tests/daemon/modbus/client.h"
#include "tests/daemon/modbus/served.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::Bytes;
using test::Connect;
using test::kReadSequence;
using test::kSequence;
using test::RawClient;
using test::ReadOne;

std::vector<int> OpenDescriptors() {
  std::vector<int> open;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    open.push_back(std::stoi(entry.path().filename()));
  }
  return open;  // with the one that looks
}

/// Whether it comes true before the guard ends.
template <typename Condition>
bool ComesTrue(Condition condition) {
  const auto guard = std::chrono::steady_clock::now() + std::chrono::milliseconds{test::kGuardMs};
  while (!condition()) {
    if (std::chrono::steady_clock::now() > guard) return false;
    std::this_thread::sleep_for(1ms);
  }
  return true;
}

/// Lowers how many descriptors the process may have, and puts it back.
class DescriptorLimit {
 public:
  explicit DescriptorLimit(rlim_t limit) {
    if (getrlimit(RLIMIT_NOFILE, &before_) != 0) throw std::runtime_error("getrlimit");
    const rlimit lowered{limit, before_.rlim_max};
    if (setrlimit(RLIMIT_NOFILE, &lowered) != 0) throw std::runtime_error("setrlimit");
  }
  ~DescriptorLimit() { setrlimit(RLIMIT_NOFILE, &before_); }
  DescriptorLimit(const DescriptorLimit&) = delete;
  DescriptorLimit& operator=(const DescriptorLimit&) = delete;

 private:
  rlimit before_{};
};

TEST(ModbusServerCrowd, BurstOfAThousandLeaksNothingAndDisturbsNobody) {
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &limit), 0);
  if (limit.rlim_cur < 2200) GTEST_SKIP() << "needs 2200 descriptors: ulimit -n";
  const test::Served served;
  const auto master = Connect(served.Port());
  // It counts as a polling client once it has kept asking for a second; half of the burst asks, too.
  const auto settled = std::chrono::steady_clock::now() + 1100ms;
  while (std::chrono::steady_clock::now() < settled) ASSERT_EQ(ReadOne(master.get(), 5), 17);
  const std::size_t before = OpenDescriptors().size();
  std::vector<std::unique_ptr<RawClient>> burst;
  for (int i = 0; i < 1000; ++i) {
    burst.push_back(std::make_unique<RawClient>(served.Port()));
    if (i % 2 == 0) (void)burst.back()->Send(kReadSequence);
    if (i % 50 != 0) continue;
    ASSERT_EQ(ReadOne(master.get(), 5), 17) << "after " << i;
  }
  EXPECT_LE(served.Counters().clients, 32U);
  burst.clear();
  EXPECT_TRUE(ComesTrue([&] { return OpenDescriptors().size() == before; })) << OpenDescriptors().size() - before;
  EXPECT_EQ(served.Counters().clients, 1U);
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
}

TEST(ModbusServerCrowd, RunsOutOfDescriptorsAndRecovers) {
  const test::Served served;
  const auto master = Connect(served.Port());
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
  std::vector<FileDescriptor> hoard;
  std::unique_ptr<RawClient> newcomer;
  {
    const std::vector<int> open = OpenDescriptors();
    const DescriptorLimit limit(static_cast<rlim_t>(*std::max_element(open.begin(), open.end())) + 3);
    while (true) {
      const int fd = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
      if (fd < 0) break;
      hoard.emplace_back(fd);
    }
    ASSERT_EQ(errno, EMFILE);
    ASSERT_FALSE(hoard.empty());
    hoard.pop_back();  // the one for the newcomer's own end
    newcomer = std::make_unique<RawClient>(served.Port());
    ASSERT_TRUE(newcomer->Send(kReadSequence));
    for (int i = 0; i < 100; ++i) ASSERT_EQ(ReadOne(master.get(), 5), 17);
    EXPECT_EQ(served.Counters().clients, 1U);
    hoard.clear();
  }
  EXPECT_EQ(newcomer->Receive(kSequence.size()), kSequence);
}

TEST(ModbusServerCrowd, DisconnectFloodLeavesThePollingMasterAlone) {
  const test::Served served;
  const auto master = Connect(served.Port());
  for (int i = 0; i < 500; ++i) {
    (void)RawClient(served.Port()).Send(kReadSequence);
    ASSERT_EQ(ReadOne(master.get(), 5), 17) << "after " << i;
  }
}

TEST(ModbusServerCrowd, EndlessPipelinesLeaveTurnsToOthers) {
  const test::Served served;
  const auto master = Connect(served.Port());
  Bytes requests;
  for (int i = 0; i < 1000; ++i) requests.insert(requests.end(), kReadSequence.begin(), kReadSequence.end());
  std::vector<std::jthread> greedy;
  for (int i = 0; i < 4; ++i) {
    greedy.emplace_back([&](const std::stop_token& stop) {
      RawClient client(served.Port());
      EXPECT_TRUE(client.Send(requests));
      while (!stop.stop_requested()) {  // always a thousand requests ahead
        EXPECT_TRUE(client.Send(requests));
        EXPECT_EQ(client.Receive(requests.size() / kReadSequence.size() * kSequence.size()).size(), 11000U);
      }
    });
  }
  ASSERT_TRUE(ComesTrue([&] { return served.Counters().requests > 10000; }));
  for (int i = 0; i < 200; ++i) ASSERT_EQ(ReadOne(master.get(), 5), 17);
}

TEST(ModbusServerCrowd, AcceptedSocketsKnowAPeerThatVanished) {
  const test::Served served;
  const auto master = Connect(served.Port());
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
  const std::uint16_t client_port = BoundPort(modbus_get_socket(master.get()));
  int accepted = -1;  // the server's end lives in this process as well
  for (const int fd : OpenDescriptors()) {
    sockaddr_in peer{};
    socklen_t size = sizeof peer;
    if (getpeername(fd, reinterpret_cast<sockaddr*>(&peer), &size) == 0 && ntohs(peer.sin_port) == client_port) {
      accepted = fd;
    }
  }
  ASSERT_GE(accepted, 0);
  const auto option = [&](int level, int name) {
    int value = -1;
    socklen_t size = sizeof value;
    getsockopt(accepted, level, name, &value, &size);
    return value;
  };
  EXPECT_EQ(option(SOL_SOCKET, SO_KEEPALIVE), 1);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPIDLE), 20);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPINTVL), 10);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPCNT), 3);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_USER_TIMEOUT), 20000);
  EXPECT_NE(option(IPPROTO_TCP, TCP_NODELAY), 0);
}

}  // namespace
}  // namespace granary
