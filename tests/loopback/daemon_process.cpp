// Children are waited for by polling their own progress, never by sleeping for a guess.
#include "tests/loopback/daemon_process.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <thread>

namespace granary {
namespace {

std::string ReadAll(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

DaemonProcess::DaemonProcess(const std::filesystem::path& folder, const std::vector<std::string>& arguments,
                             int listener)
    : folder_(folder) {
  std::vector<char*> argv{const_cast<char*>(GRANARYD)};
  for (const auto& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const std::string state = (folder / "state").string(), out = folder / "stdout.txt", err = folder / "stderr.txt";
  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("fork failed");
  if (pid_ == 0) {
    setenv("STATE_DIRECTORY", state.c_str(), 1);
    unsetenv("JOURNAL_STREAM");
    unsetenv("NOTIFY_SOCKET");
    if (exists(folder / "notify")) setenv("NOTIFY_SOCKET", (folder / "notify").c_str(), 1);
    dup2(open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDOUT_FILENO);
    dup2(open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDERR_FILENO);
    if (listener >= 0) {
      constexpr int kFirstListener = 3;  // sd_listen_fds(3)
      dup2(listener, kFirstListener);    // of the same number: only the flag would stay
      fcntl(kFirstListener, F_SETFD, 0);
      setenv("LISTEN_FDS", "1", 1);
      setenv("LISTEN_PID", std::to_string(getpid()).c_str(), 1);
    }
    execv(GRANARYD, argv.data());
    _exit(127);
  }
}

DaemonProcess::~DaemonProcess() {
  if (!Running()) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

void DaemonProcess::Signal(int signal) const { kill(pid_, signal); }

bool DaemonProcess::Running() {
  if (status_) return false;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) == pid_) status_ = status;
  return !status_;
}

std::optional<int> DaemonProcess::ExitCode() {
  if (!Eventually([this] { return !Running(); }) || !WIFEXITED(*status_)) return std::nullopt;
  return WEXITSTATUS(*status_);
}

std::string DaemonProcess::Stdout() const { return ReadAll(folder_ / "stdout.txt"); }
std::string DaemonProcess::Stderr() const { return ReadAll(folder_ / "stderr.txt"); }

bool Eventually(const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes{2};
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds{20});  // leaves the processor to the daemon
  }
  return true;
}

std::uint16_t FreePort() {
  const int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  const bool ok = bind(listener, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size) == 0;
  close(listener);
  if (!ok) throw std::runtime_error("no free port");
  return ntohs(address.sin_port);
}

bool HasMbpoll() { return std::system("command -v mbpoll >/dev/null 2>&1") == 0; }

std::optional<double> ReadModbus(std::uint16_t port, int address, const std::string& type) {
  // -0: addresses count from 0; -B: high word first; -1: once; -q is left out, for it hides errors too.
  const std::string command = "mbpoll -m tcp -a 1 -p " + std::to_string(port) + " -0 -1 -B -t " + type + " -r " +
                              std::to_string(address) + " -c 1 127.0.0.1 2>/dev/null";
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  if (!pipe) return std::nullopt;
  char line[256];
  const std::string mark = "[" + std::to_string(address) + "]:";
  while (std::fgets(line, sizeof line, pipe.get()) != nullptr) {
    const std::string text(line);
    const auto found = text.find(mark);
    if (found != std::string::npos) return std::strtod(text.c_str() + found + mark.size(), nullptr);
  }
  return std::nullopt;
}

}  // namespace granary
