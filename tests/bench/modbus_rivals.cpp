// Each rival is forked before any thread exists here, says its port through a pipe and serves until it is killed.
#include "tests/bench/modbus_rivals.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <filesystem>
#include <iterator>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sched.h>
#include <sys/epoll.h>
#include <sys/prctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/socket.h"
#include "tests/daemon/modbus/served.h"

namespace granary::bench {
namespace {

int Checked(int result, const char* call) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), call);
  return result;
}

void Say(int pipe, std::uint16_t port) {
  if (write(pipe, &port, sizeof port) != sizeof port) {
    throw std::system_error(errno, std::generic_category(), "write to the bench");
  }
}

[[noreturn]] void ServeOurs(int pipe, int max_clients) {
  ModbusTcpOptions options;
  options.max_clients = max_clients;
  test::Served served({}, options);
  Say(pipe, served.Port());
  for (BinSnapshot snapshot = test::GoodSnapshot();; ++snapshot.heartbeat) {
    served.units.Publish(snapshot);
    std::this_thread::sleep_for(std::chrono::seconds{1});
  }
}

/// Error handling, too, is that of libmodbus' own examples: none but closing.
[[noreturn]] void ServeLibmodbus(int pipe) {
  modbus_t* context = modbus_new_tcp("127.0.0.1", 0);
  modbus_mapping_t* mapping = modbus_mapping_new(48, 48, kRegisterCount, kRegisterCount);
  if (context == nullptr || mapping == nullptr) throw std::runtime_error(modbus_strerror(errno));
  const int listener = Checked(modbus_tcp_listen(context, 1024), "modbus_tcp_listen");
  Say(pipe, BoundPort(listener));
  fd_set all;
  FD_ZERO(&all);
  FD_SET(listener, &all);
  int highest = listener;
  std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request;
  while (true) {
    fd_set ready = all;
    if (select(highest + 1, &ready, nullptr, nullptr, nullptr) < 0) continue;
    for (int fd = 0; fd <= highest; ++fd) {
      if (!FD_ISSET(fd, &ready)) continue;
      if (fd == listener) {
        const int client = accept(listener, nullptr, nullptr);
        if (client < 0) continue;
        if (client >= FD_SETSIZE) {
          close(client);
          continue;
        }
        const int on = 1;  // or several requests outstanding would measure Nagle's wait
        setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        FD_SET(client, &all);
        highest = std::max(highest, client);
        continue;
      }
      modbus_set_socket(context, fd);
      const int bytes = modbus_receive(context, request.data());
      if (bytes > 0) {
        modbus_reply(context, request.data(), bytes, mapping);
      } else if (bytes < 0) {
        FD_CLR(fd, &all);
        close(fd);
      }
    }
  }
}

[[noreturn]] void ServeFloor(int pipe) {
  const FileDescriptor listener = ListenTcp("127.0.0.1", 0);
  Say(pipe, BoundPort(listener.Get()));
  const int poll = Checked(epoll_create1(0), "epoll_create1");
  const auto watch = [&](int fd) {
    epoll_event event{.events = EPOLLIN, .data = {.fd = fd}};
    Checked(epoll_ctl(poll, EPOLL_CTL_ADD, fd, &event), "epoll_ctl");
  };
  watch(listener.Get());
  constexpr std::size_t kRequestBytes = 12, kMost = 64;
  std::vector<std::uint8_t> pdu(2 + 250, 0), replies;
  pdu[0] = 3;
  pdu[1] = 250;
  for (std::size_t i = 0; i < kMost; ++i) AppendFrame(0, 1, pdu, replies);
  std::array<std::uint8_t, kMost * kRequestBytes> chunk;
  std::array<epoll_event, 64> events;
  while (true) {
    const int ready = epoll_wait(poll, events.data(), events.size(), -1);
    for (int i = 0; i < ready; ++i) {
      const int fd = events[i].data.fd;
      if (fd == listener.Get()) {
        const int client = accept4(fd, nullptr, nullptr, SOCK_NONBLOCK);
        if (client >= 0) watch(client);
        continue;
      }
      const ssize_t got = recv(fd, chunk.data(), chunk.size(), 0);
      const auto asked = static_cast<std::size_t>(std::max<ssize_t>(got, 0)) / kRequestBytes;
      if (got <= 0 || send(fd, replies.data(), asked * replies.size() / kMost, MSG_NOSIGNAL) < 0) close(fd);
    }
  }
}

/// Its result is never used, so that it must be seen to matter.
[[noreturn]] void Spin() {
  volatile double x = 1;
  while (true) x = 1.0000001 * x + 1e-9;
}

}  // namespace

std::string_view NameOf(Rival rival) {
  switch (rival) {
    case Rival::kOurs:
      return "ours";
    case Rival::kLibmodbus:
      return "libmodbus";
    case Rival::kFloor:
      return "floor";
  }
  return "";
}

void PinTo(int core) {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  CPU_SET(core, &cores);
  Checked(sched_setaffinity(0, sizeof cores, &cores), "sched_setaffinity");
}

bool GoFirst() {
  const sched_param first{.sched_priority = 1};
  return sched_setscheduler(0, SCHED_FIFO, &first) == 0;
}

void DieWithParent() { prctl(PR_SET_PDEATHSIG, SIGKILL); }

ServerProcess::ServerProcess(Rival rival, int core, int spinners, int max_clients) {
  std::array<int, 2> ends{};
  Checked(pipe(ends.data()), "pipe");
  const FileDescriptor from(ends[0]);
  FileDescriptor to(ends[1]);
  std::fflush(nullptr);
  pid_ = Checked(fork(), "fork");
  if (pid_ == 0) {
    try {
      DieWithParent();
      if (core >= 0) {
        PinTo(core);
        GoFirst();
      }
      for (int i = 0; i < spinners; ++i) std::thread(Spin).detach();
      if (rival == Rival::kOurs) ServeOurs(to.Get(), max_clients);
      if (rival == Rival::kLibmodbus) ServeLibmodbus(to.Get());
      ServeFloor(to.Get());
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s: %s\n", std::string(NameOf(rival)).c_str(), error.what());
      std::_Exit(1);
    }
  }
  to = FileDescriptor();  // a server that ended leaves no writer, so that read returns
  if (read(from.Get(), &port_, sizeof port_) != sizeof port_) throw std::runtime_error("a server did not start");
}

ServerProcess::~ServerProcess() {
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

double ServerProcess::CpuSeconds() const {
  clockid_t clock{};
  timespec time{};
  if (clock_getcpuclockid(pid_, &clock) != 0 || clock_gettime(clock, &time) != 0) {
    throw std::runtime_error("no processor time of the server");
  }
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

int ServerProcess::Descriptors() const {
  const std::filesystem::directory_iterator open("/proc/" + std::to_string(pid_) + "/fd");
  return static_cast<int>(std::distance(begin(open), end(open)));
}

bool ServerProcess::Running() const { return waitpid(pid_, nullptr, WNOHANG) == 0; }

}  // namespace granary::bench
