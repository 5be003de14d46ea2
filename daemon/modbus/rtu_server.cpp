// One thread: it waits for bytes or for the framing's deadline, and asks for requests only when there is nothing left
// to read, so that time lost to other programs cannot make a silence out of bytes that wait in the kernel.
#include "daemon/modbus/rtu_server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <system_error>

#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <time.h>

#include "daemon/fault_log.h"
#include "daemon/modbus/prompt_thread.h"
#include "daemon/modbus/rtu_framing.h"
#include "daemon/modbus/serial_port.h"

namespace granary {
namespace {

using Steady = std::chrono::steady_clock;

constexpr int kLastAddress = 247;

bool MayBeSentToAll(std::uint8_t function) {
  constexpr std::array<std::uint8_t, 5> kWrites{5, 6, 15, 16, 22};
  return std::find(kWrites.begin(), kWrites.end(), function) != kWrites.end();
}

void RequireBins(const ModbusRtuOptions& options, const ModbusUnits& units) {
  for (const int unit : options.units) {
    if (unit < 1 || unit > kLastAddress || !units.Serves(static_cast<std::uint8_t>(unit))) {
      throw std::invalid_argument("modbus.rtu.units: " + std::to_string(unit) + " is no bin's id; must be ids of bins");
    }
  }
}

}  // namespace

/// What the server's thread owns.
class RtuServer::Loop {
 public:
  Loop(const ModbusRtuOptions& options, ModbusUnits& units, ModbusTally& tally, RtuReopening reopening)
      : options_(options),
        units_(units),
        tally_(tally),
        reopening_(reopening),
        wake_(Checked(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK), "eventfd")) {
    RequireBins(options_, units_);
    try {
      Open();
    } catch (const SerialError& error) {
      if (!reopening_.wait_for_port) throw;
      spdlog::error("modbus: {}; trying again", error.what());
      delay_ = reopening_.first;
    }
  }

  void Run(const std::stop_token& stop) {
    const std::stop_callback wake(stop, [this] { eventfd_write(wake_.Get(), 1); });
    while (!stop.stop_requested()) {
      if (!port_) {
        Reopen();
        continue;
      }
      try {
        Turn();
      } catch (const SerialError& error) {
        spdlog::warn("modbus: {}; waiting for it to come back", error.what());
        port_.reset();
        delay_ = reopening_.first;
      }
    }
  }

 private:
  void Open() {
    port_.emplace(options_);
    framing_.emplace(
        TimingOf(options_.baud), [this](std::uint8_t address) { return Serves(address); }, tally_);
    errors_before_ = tally_.rtu_errors;
    looks_wrong_ = false;
  }

  void Reopen() {
    if (Wait(-1, Steady::now() + delay_)) return;  // bytes or the stop
    delay_ = std::min(delay_ * 2, reopening_.most);
    try {
      Open();
      reopen_log_.Clear();
      spdlog::info("modbus: {} is back", options_.device);
    } catch (const SerialError& error) {
      // That an adapter is missing was said when it went; that one is there and cannot be used is news.
      if (error.Code() != ENOENT && reopen_log_.Raise(error.what(), Steady::now())) {
        spdlog::warn("modbus: {}; trying again", error.what());
      }
    }
  }

  bool Serves(std::uint8_t address) const {
    const bool listed = options_.units.empty() ||
                        std::find(options_.units.begin(), options_.units.end(), address) != options_.units.end();
    return listed && units_.Serves(address);
  }

  /// Waits for `port` (-1: none), for the stop, or until a time. @return whether there was anything but the time
  bool Wait(int port, std::optional<Steady::time_point> until) const {
    std::array<pollfd, 2> watched{{{wake_.Get(), POLLIN, 0}, {port, POLLIN, 0}}};
    timespec timeout{};
    if (until) {
      const auto left = std::max(Steady::duration::zero(), *until - Steady::now());
      const auto seconds = std::chrono::floor<std::chrono::seconds>(left);
      timeout.tv_sec = static_cast<time_t>(seconds.count());
      timeout.tv_nsec = static_cast<long>(std::chrono::nanoseconds(left - seconds).count());
    }
    const int ready = ppoll(watched.data(), watched.size(), until ? &timeout : nullptr, nullptr);
    if (ready < 0 && errno != EINTR) throw std::system_error(errno, std::generic_category(), "ppoll");
    return ready != 0;
  }

  /// @throws SerialError when the port is gone
  void Turn() {
    if (Wait(port_->Descriptor(), framing_->Deadline())) {
      std::array<std::uint8_t, 4096> room;
      const std::size_t got = port_->Read(room);
      framing_->Receive(std::span(room).first(got), Steady::now());
      return;
    }
    while (const auto request = framing_->Next(Steady::now())) Serve(*request);
    WarnOfWrongSettings();
  }

  void Serve(const RtuRequest& request) {
    const Requester requester{options_.device, options_.write};
    if (request.address == 0) {
      // Most of what is sent to all is meant for others; what could not be written anyway is no refusal to speak of.
      if (!options_.write || !MayBeSentToAll(request.pdu.front())) {
        ++tally_.rtu_others;
        return;
      }
      ++tally_.rtu_requests;
      for (int unit = 1; unit <= kLastAddress; ++unit) {
        const auto address = static_cast<std::uint8_t>(unit);
        if (Serves(address)) static_cast<void>(units_.Answer(address, request.pdu, requester));
      }
      return;
    }
    // Counted first, so that a request that reads the counter finds itself in it.
    ++tally_.rtu_requests;
    const auto reply = RtuFrame(request.address, units_.Answer(request.address, request.pdu, requester));
    if (port_->HasInput()) {
      spdlog::debug("modbus: {}: unit {} not answered, the line is in use again", options_.device, request.address);
      return;
    }
    port_->Send(reply);
    framing_->Sent(reply, Steady::now());
  }

  void WarnOfWrongSettings() {
    constexpr std::uint32_t kManyErrors = 20;
    if (looks_wrong_ || tally_.rtu_requests != 0 || tally_.rtu_others != 0) return;
    if (tally_.rtu_errors - errors_before_ < kManyErrors) return;
    looks_wrong_ = true;
    spdlog::warn(
        "modbus: {}: nothing heard so far is a Modbus frame; check baud ({}), parity ({}) and the wires A and B",
        options_.device, options_.baud, options_.parity);
  }

  const ModbusRtuOptions options_;
  ModbusUnits& units_;
  ModbusTally& tally_;
  const RtuReopening reopening_;
  FileDescriptor wake_;
  std::optional<SerialPort> port_;
  std::optional<RtuFraming> framing_;
  std::chrono::milliseconds delay_{};
  FaultLog reopen_log_;
  std::uint32_t errors_before_ = 0;
  bool looks_wrong_ = false;
};

RtuServer::RtuServer(const ModbusRtuOptions& options, ModbusUnits& units, ModbusTally& tally, RtuReopening reopening)
    : loop_(std::make_unique<Loop>(options, units, tally, reopening)), thread_([this](const std::stop_token& stop) {
        BePrompt("modbus-rtu");
        loop_->Run(stop);
      }) {}

RtuServer::~RtuServer() = default;

}  // namespace granary
