// Serial lines made of pseudo terminals: the far end of one, a cable between two, and a server on the near end.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include "daemon/modbus/rtu_server.h"
#include "daemon/modbus/socket.h"
#include "tests/daemon/modbus/recording_control.h"
#include "tests/daemon/modbus/rtu_listener.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary::test {

/// Guards against a test that hangs; no test waits for it to pass.
inline constexpr int kLineGuardMs = 20000;

/// The far end of a line whose near end is a device that can be opened by its path.
class Pty {
 public:
  Pty() : master_(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK)) {
    std::array<char, 128> name{};
    if (grantpt(master_.Get()) != 0 || unlockpt(master_.Get()) != 0 ||
        ptsname_r(master_.Get(), name.data(), name.size()) != 0) {
      throw std::runtime_error("no pseudo terminal here");
    }
    path_ = name.data();
    // Held open so that the far end works before and after anybody uses the near one; raw, so that nothing is echoed.
    slave_ = FileDescriptor(open(path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
    termios line{};
    tcgetattr(slave_.Get(), &line);
    cfmakeraw(&line);
    tcsetattr(slave_.Get(), TCSANOW, &line);
  }
  [[nodiscard]] const std::string& Path() const { return path_; }
  [[nodiscard]] int Descriptor() const { return master_.Get(); }

  void Send(const Bytes& bytes) const {
    if (write(master_.Get(), bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) {
      throw std::runtime_error("the line takes no bytes");
    }
  }
  /// What has arrived; waits for the first byte.
  [[nodiscard]] Bytes ReceiveSome() const {
    pollfd ready{master_.Get(), POLLIN, 0};
    if (poll(&ready, 1, kLineGuardMs) != 1) throw std::runtime_error("nothing comes over the line");
    Bytes bytes(4096);
    const ssize_t got = read(master_.Get(), bytes.data(), bytes.size());
    bytes.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return bytes;
  }
  [[nodiscard]] Bytes Receive(std::size_t count) const {
    Bytes all;
    while (all.size() < count) {
      const Bytes some = ReceiveSome();
      all.insert(all.end(), some.begin(), some.end());
    }
    return all;
  }
  /// Whether nothing waits to be received.
  [[nodiscard]] bool IsSilent() const {
    pollfd ready{master_.Get(), POLLIN, 0};
    return poll(&ready, 1, 0) == 0;
  }

 private:
  FileDescriptor master_, slave_;
  std::string path_;
};

/// Joins the far ends of two lines, and remembers what `from` sent.
class Cable {
 public:
  /// @param echo whether `to` hears what it sends itself
  Cable(const Pty& from, const Pty& to, bool echo = false)
      : thread_([this, &from, &to, echo](const std::stop_token& stop) {
          while (!stop.stop_requested()) {
            std::array<pollfd, 2> ends{{{from.Descriptor(), POLLIN, 0}, {to.Descriptor(), POLLIN, 0}}};
            poll(ends.data(), ends.size(), 10);
            if (ends[0].revents != 0) {
              const Bytes bytes = from.ReceiveSome();
              sent_.insert(sent_.end(), bytes.begin(), bytes.end());
              to.Send(bytes);
            }
            if (ends[1].revents != 0) {
              const Bytes bytes = to.ReceiveSome();
              if (echo) to.Send(bytes);
              from.Send(bytes);
            }
          }
        }) {}
  /// What `from` has sent so far; ends the cable.
  const Bytes& Sent() {
    thread_ = {};
    return sent_;
  }

 private:
  Bytes sent_;  ///< the thread's until it is joined
  std::jthread thread_;
};

/// Bins 3 and 5, measured a moment ago.
struct RtuUnits {
  explicit RtuUnits(std::function<UtcTime()> utc_now = {})
      : units(kIdentity, {GoodSnapshot().bin, SecondBin()}, control, tally, std::move(utc_now)) {
    units.Publish(GoodSnapshot());
  }
  static Bin SecondBin() {
    Bin bin = GoodSnapshot().bin;
    bin.id = 5;
    return bin;
  }
  [[nodiscard]] ModbusCounters Counters() const { return tally.Read(); }

  RecordingControl control;
  ModbusTally tally;
  ModbusUnits units;
};

inline ModbusRtuOptions OptionsFor(const std::string& device) {
  ModbusRtuOptions options;
  options.device = device;
  options.baud = 115200;
  return options;
}

/// The answer to ReadRequest(address, 5): the sequence of the published measurement.
inline Bytes SequenceReply(int address = kUs) { return ReadReply(address, {0, 17}); }

}  // namespace granary::test
