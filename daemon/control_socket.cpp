// Few clients, short lines: one thread polls them all, and whoever dawdles is dropped.
#include "daemon/control_socket.h"

#include <fcntl.h>
#include <poll.h>
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <list>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

namespace granary {
namespace {

using Json = nlohmann::json;
using SteadyClock = std::chrono::steady_clock;

constexpr std::size_t kMaxLine = 4096;
constexpr std::size_t kMaxClients = 16;
constexpr std::chrono::seconds kAnswerTime{5}, kIdleTime{60}, kPatience{10};
constexpr const char* kFile = "control.sock";

[[noreturn]] void Refuse(const std::filesystem::path& file, const std::string& what) {
  throw std::runtime_error("local socket " + file.string() + ": " + what);
}

[[noreturn]] void RefuseErrno(const std::filesystem::path& file, const char* operation) {
  const int error = errno;
  Refuse(file, std::string(operation) + ": " + std::strerror(error));
}

sockaddr_un AddressOf(const std::filesystem::path& file) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = file.string();
  if (name.size() >= sizeof address.sun_path) {
    Refuse(file,
           fmt::format("the name has {} bytes, at most {} are allowed", name.size(), sizeof address.sun_path - 1));
  }
  std::memcpy(address.sun_path, name.data(), name.size());
  return address;
}

/// The first folder of a list as systemd sets it; empty when the variable is not set.
std::filesystem::path RuntimeFolder() {
  const char* const value = std::getenv("RUNTIME_DIRECTORY");
  const std::string folders = value == nullptr ? "" : value;
  return folders.substr(0, folders.find(':'));
}

FileDescriptor Lock(const std::filesystem::path& folder) {
  const auto file = folder / "control.lock";
  FileDescriptor lock(open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640));
  if (lock.Get() < 0) RefuseErrno(file, "open");
  if (flock(lock.Get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) Refuse(folder / kFile, "another granaryd listens there");
    RefuseErrno(file, "lock");
  }
  return lock;
}

FileDescriptor Listen(const std::filesystem::path& file) {
  const sockaddr_un address = AddressOf(file);
  // We hold the lock: whoever listened here is dead.
  if (unlink(file.c_str()) != 0 && errno != ENOENT) RefuseErrno(file, "remove the stale socket");
  FileDescriptor socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (socket.Get() < 0) RefuseErrno(file, "socket");
  // Born closed to all, so that there is no moment in which it is open to too many.
  if (fchmod(socket.Get(), 0600) != 0) RefuseErrno(file, "set the mode");
  if (bind(socket.Get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) RefuseErrno(file, "bind");
  if (listen(socket.Get(), static_cast<int>(kMaxClients)) != 0) RefuseErrno(file, "listen");
  if (chmod(file.c_str(), 0660) != 0) RefuseErrno(file, "set the mode");
  return socket;
}

std::string NameOfPeer(int socket) {
  ucred credentials{};
  socklen_t size = sizeof credentials;
  if (getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &credentials, &size) != 0) return "local";
  return fmt::format("local uid {}", credentials.uid);
}

std::string Line(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace) + '\n'; }

/// One client.
struct Peer {
  FileDescriptor socket;
  std::string who;
  std::string in, out;
  bool closing = false;  ///< once its answer is out
  SteadyClock::time_point active = SteadyClock::now();
  /// When it is dropped.
  [[nodiscard]] SteadyClock::time_point Deadline() const {
    return active + (in.empty() && out.empty() ? kIdleTime : kAnswerTime);
  }
};

std::string Answer(const std::string& line, const std::string& who, const ControlSocket::Handler& handler) {
  try {
    return Line(handler(Json::parse(line), who));
  } catch (const Json::parse_error& error) {
    return Line({{"error", std::string("not one JSON object a line: ") + error.what()}});
  } catch (const std::exception& error) {
    spdlog::error("local socket: {} from {}: {}", line, who, error.what());
    return Line({{"error", std::string("internal: ") + error.what()}});
  }
}

/// Takes what came; @return false when the client is gone.
bool Receive(Peer& peer, const ControlSocket::Handler& handler) {
  std::array<char, kMaxLine> bytes;
  const ssize_t count = recv(peer.socket.Get(), bytes.data(), bytes.size(), 0);
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  if (count == 0) return false;
  // A line has its time from its first byte on, however slowly the others drip in.
  if (peer.in.empty()) peer.active = SteadyClock::now();
  peer.in.append(bytes.data(), static_cast<std::size_t>(count));
  for (std::size_t end = 0; (end = peer.in.find('\n')) != std::string::npos && end <= kMaxLine;) {
    peer.out += Answer(peer.in.substr(0, end), peer.who, handler);
    peer.in.erase(0, end + 1);
    peer.active = SteadyClock::now();
  }
  if (peer.in.size() > kMaxLine) {
    peer.out += Line({{"error", fmt::format("the request is too long, at most {} bytes are allowed", kMaxLine)}});
    peer.closing = true;
  }
  return true;
}

/// @return false when the client is gone, or has all that it gets
bool Send(Peer& peer) {
  const ssize_t count = send(peer.socket.Get(), peer.out.data(), peer.out.size(), MSG_NOSIGNAL);
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  peer.out.erase(0, static_cast<std::size_t>(count));
  if (!peer.out.empty()) return true;
  peer.active = SteadyClock::now();
  return !peer.closing;
}

}  // namespace

std::filesystem::path ControlFolder(const std::filesystem::path& state_folder) {
  const auto folder = RuntimeFolder();
  return folder.empty() ? state_folder : folder;
}

ControlSocket::ControlSocket(const std::filesystem::path& folder, Handler handler)
    : file_(folder / kFile), handler_(std::move(handler)) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) Refuse(file_, "create the folder: " + error.message());
  lock_ = Lock(folder);
  listener_ = Listen(file_);
  wake_ = FileDescriptor(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (wake_.Get() < 0) RefuseErrno(file_, "eventfd");
  thread_ = std::jthread([this](const std::stop_token& stop) { Run(stop); });
}

ControlSocket::~ControlSocket() {
  thread_.request_stop();
  const std::uint64_t one = 1;
  // Only fails when the counter is full, and then the thread is awake already.
  [[maybe_unused]] const auto written = write(wake_.Get(), &one, sizeof one);
  thread_.join();
  unlink(file_.c_str());  // one that stays is replaced by the next daemon
}

void ControlSocket::Run(const std::stop_token& stop) {
  std::list<Peer> peers;
  SteadyClock::time_point accept_from{};  // later after a lack of descriptors, which would be a busy loop
  while (!stop.stop_requested()) {
    const auto now = SteadyClock::now();
    std::erase_if(peers, [&](const Peer& peer) { return now >= peer.Deadline(); });
    const bool accepting = now >= accept_from;
    auto until = accepting ? now + kIdleTime : accept_from;
    std::vector<pollfd> polled{{wake_.Get(), POLLIN, 0},
                               {listener_.Get(), static_cast<short>(accepting ? POLLIN : 0), 0}};
    for (const Peer& peer : peers) {
      until = std::min(until, peer.Deadline());
      polled.push_back({peer.socket.Get(), static_cast<short>(peer.out.empty() ? POLLIN : POLLOUT), 0});
    }
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - now);
    if (poll(polled.data(), polled.size(), static_cast<int>(left.count())) < 0) {
      if (errno == EINTR) continue;
      spdlog::error("local socket {}: poll: {}", file_.string(), std::strerror(errno));
      std::this_thread::sleep_for(std::chrono::milliseconds{100});  // for want of memory; no busy loop
      continue;
    }
    std::size_t index = 2;
    for (auto peer = peers.begin(); peer != peers.end(); ++index) {
      const short events = polled[index].revents;
      bool stays = true;
      if ((events & POLLIN) != 0) stays = Receive(*peer, handler_);
      if (stays && !peer->out.empty()) stays = Send(*peer);
      if (stays && (events & (POLLERR | POLLNVAL)) != 0) stays = false;
      if (stays && (events & (POLLIN | POLLHUP)) == POLLHUP) stays = false;
      peer = stays ? std::next(peer) : peers.erase(peer);
    }
    if ((polled[1].revents & POLLIN) == 0) continue;
    FileDescriptor socket(accept4(listener_.Get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (socket.Get() < 0) {
      if (errno == EAGAIN || errno == EINTR || errno == ECONNABORTED) continue;
      spdlog::error("local socket {}: accept: {}", file_.string(), std::strerror(errno));
      accept_from = SteadyClock::now() + std::chrono::seconds{1};
      continue;
    }
    if (peers.size() >= kMaxClients) {
      peers.erase(std::min_element(peers.begin(), peers.end(),
                                   [](const Peer& a, const Peer& b) { return a.active < b.active; }));
    }
    std::string who = NameOfPeer(socket.Get());
    peers.push_back({.socket = std::move(socket), .who = std::move(who), .in = {}, .out = {}});
  }
}

namespace {

/// Connects to FILE; an invalid descriptor, with errno set, when nobody listens there or it is not ours to ask.
FileDescriptor Connect(const std::filesystem::path& file) {
  const sockaddr_un address = AddressOf(file);
  FileDescriptor socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (socket.Get() < 0) RefuseErrno(file, "socket");
  const timeval patience{.tv_sec = kPatience.count(), .tv_usec = 0};
  if (setsockopt(socket.Get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) != 0 ||
      setsockopt(socket.Get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience) != 0) {
    RefuseErrno(file, "set the timeout");
  }
  if (connect(socket.Get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return socket;
  const int error = errno;
  socket = FileDescriptor();
  errno = error;
  return socket;
}

Json Exchange(const std::filesystem::path& file, const FileDescriptor& socket, const Json& request) {
  const std::string line = Line(request);
  for (std::size_t sent = 0; sent < line.size();) {
    const ssize_t count = send(socket.Get(), line.data() + sent, line.size() - sent, MSG_NOSIGNAL);
    if (count < 0) RefuseErrno(file, "ask");
    sent += static_cast<std::size_t>(count);
  }
  std::string answer;
  std::array<char, kMaxLine> bytes;
  while (answer.find('\n') == std::string::npos) {
    const ssize_t count = recv(socket.Get(), bytes.data(), bytes.size(), 0);
    if (count < 0 && errno == EAGAIN) Refuse(file, fmt::format("no answer within {} s", kPatience.count()));
    if (count < 0) RefuseErrno(file, "read the answer");
    if (count == 0) Refuse(file, "the daemon hung up without an answer");
    answer.append(bytes.data(), static_cast<std::size_t>(count));
  }
  try {
    return Json::parse(answer);
  } catch (const Json::exception& error) {
    Refuse(file, std::string("the answer is no JSON: ") + error.what());
  }
}

}  // namespace

nlohmann::json AskDaemon(const std::filesystem::path& folder, const nlohmann::json& request) {
  std::vector<std::filesystem::path> files;
  for (const auto& place : {RuntimeFolder(), folder, std::filesystem::path("/run/granaryd")}) {
    if (!place.empty() && std::find(files.begin(), files.end(), place / kFile) == files.end()) {
      files.push_back(place / kFile);
    }
  }
  std::string looked;
  for (const auto& file : files) {
    const FileDescriptor socket = Connect(file);
    if (socket.Get() >= 0) return Exchange(file, socket, request);
    looked += fmt::format("{}{}: {}", looked.empty() ? "" : ", ", file.string(), std::strerror(errno));
  }
  throw std::runtime_error("no daemon can be asked (" + looked +
                           "): is granaryd running, and are you root or of its group?");
}

}  // namespace granary
