// The calls of the terminal interface that a Modbus line needs, each checked on its line. What a driver silently leaves
// out (an odd speed, parity, direction control) is read back and said, because on the line it looks like noise.
#include "daemon/modbus/serial_port.h"

#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

namespace granary {
namespace {

constexpr int kSendTimeoutMs = 1000;

speed_t SpeedOf(const ModbusRtuOptions& options) {
  constexpr std::array<std::pair<int, speed_t>, 8> kSpeeds{{{1200, B1200},
                                                            {2400, B2400},
                                                            {4800, B4800},
                                                            {9600, B9600},
                                                            {19200, B19200},
                                                            {38400, B38400},
                                                            {57600, B57600},
                                                            {115200, B115200}}};
  for (const auto& [baud, speed] : kSpeeds) {
    if (baud == options.baud) return speed;
  }
  throw SerialError(options.device,
                    "cannot run at " + std::to_string(options.baud) +
                        " baud; must be 1200, 2400, 4800, 9600, 19200, 38400, 57600 or 115200",
                    0);
}

tcflag_t FramingFlags(const std::string& parity) {
  if (parity == "none") return CS8 | CSTOPB;  // two stop bits, so that a character keeps its 11 bits
  return CS8 | PARENB | (parity == "odd" ? PARODD : 0);
}

/// "8E1", as manuals write it.
std::string NameOfFraming(tcflag_t flags) {
  const char bits = (flags & CSIZE) == CS8 ? '8' : '7';
  const char parity = (flags & PARENB) == 0 ? 'N' : (flags & PARODD) != 0 ? 'O' : 'E';
  return {bits, parity, (flags & CSTOPB) != 0 ? '2' : '1'};
}

FileDescriptor Open(const std::string& device) {
  FileDescriptor port(open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (port.Get() < 0) {
    const int code = errno;
    throw SerialError(device, code == EBUSY ? "cannot be opened: another program holds it" : "cannot be opened", code);
  }
  if (isatty(port.Get()) == 0) throw SerialError(device, "is no serial port", errno);
  // Programs that were started as root pass TIOCEXCL; the lock is for those among them that ask.
  if (flock(port.Get(), LOCK_EX | LOCK_NB) != 0) {
    const int code = errno;
    throw SerialError(device, code == EWOULDBLOCK ? "cannot be locked: another program holds it" : "cannot be locked",
                      code);
  }
  if (ioctl(port.Get(), TIOCEXCL) != 0) throw SerialError(device, "cannot be had for ourselves (TIOCEXCL)", errno);
  return port;
}

void SetLine(int port, const ModbusRtuOptions& options) {
  const speed_t speed = SpeedOf(options);
  const tcflag_t framing = FramingFlags(options.parity);
  constexpr tcflag_t kFraming = CSIZE | CSTOPB | PARENB | PARODD;
  termios line{};
  if (tcgetattr(port, &line) != 0) throw SerialError(options.device, "tcgetattr", errno);
  cfmakeraw(&line);
  // A break is no byte; a byte of wrong parity stays as NUL, so that its frame fails as a whole.
  line.c_iflag = IGNBRK | ((framing & PARENB) != 0 ? INPCK : 0);
  line.c_cflag &= ~(kFraming | CRTSCTS | HUPCL);
  line.c_cflag |= framing | CREAD | CLOCAL;
  line.c_cc[VMIN] = 1;  // with 0 a read could not tell "nothing yet" from "gone"
  line.c_cc[VTIME] = 0;
  if (cfsetispeed(&line, speed) != 0 || cfsetospeed(&line, speed) != 0) {
    throw SerialError(options.device, "cfsetspeed", errno);
  }
  // It succeeds when it could set anything at all, and says EINVAL (glibc) when only parity was left to be set and is
  // not taken, as on the second opening: what counts is what can be read back.
  const int code = tcsetattr(port, TCSAFLUSH, &line) == 0 ? 0 : errno;
  if (code != 0 && code != EINVAL) throw SerialError(options.device, "tcsetattr", code);
  termios taken{};
  if (tcgetattr(port, &taken) != 0) throw SerialError(options.device, "tcgetattr", errno);
  if (cfgetospeed(&taken) != speed) {
    throw SerialError(options.device, "its driver does not take baud = " + std::to_string(options.baud), 0);
  }
  const bool framing_taken = (taken.c_cflag & kFraming) == framing;
  if (code != 0 && framing_taken) throw SerialError(options.device, "tcsetattr", code);
  if (!framing_taken) {
    spdlog::warn("modbus: {}: its driver does not take parity = \"{}\": wanted {}, it has {}", options.device,
                 options.parity, NameOfFraming(framing), NameOfFraming(taken.c_cflag));
  }
}

/// Bytes at once instead of a USB adapter's 16 ms later. Many drivers have no such thing, and all work without.
void AskForLowLatency(int port, const std::string& device) {
  serial_struct serial{};
  if (ioctl(port, TIOCGSERIAL, &serial) == 0) {
    serial.flags |= ASYNC_LOW_LATENCY;
    if (ioctl(port, TIOCSSERIAL, &serial) == 0) return;
  }
  spdlog::debug("modbus: {}: no low latency: {}", device, std::generic_category().message(errno));
}

void SetRs485(int port, const ModbusRtuOptions& options) {
  const serial_rs485 asked = Rs485Of(options);
  serial_rs485 taken = asked;
  if (ioctl(port, TIOCSRS485, &taken) != 0) {
    throw SerialError(options.device,
                      "its driver cannot switch a transceiver's direction (TIOCSRS485); rs485 must be false here, with "
                      "an adapter that switches by itself",
                      errno);
  }
  const std::string refused = Rs485Refused(asked, taken);
  if (!refused.empty()) throw SerialError(options.device, "its driver does not take " + refused, 0);
}

}  // namespace

SerialError::SerialError(const std::string& device, const std::string& what, int code)
    : std::runtime_error(device + ": " + what + (code == 0 ? "" : ": " + std::generic_category().message(code))),
      code_(code) {}

SerialPort::SerialPort(const ModbusRtuOptions& options) : device_(options.device), port_(Open(options.device)) {
  SetLine(port_.Get(), options);
  AskForLowLatency(port_.Get(), device_);
  if (options.rs485) SetRs485(port_.Get(), options);
}

SerialPort::~SerialPort() {
  // The mark may outlive the descriptor and would keep the next one out; on a port that is gone it is gone, too.
  if (ioctl(port_.Get(), TIOCNXCL) != 0) {
    spdlog::debug("modbus: {}: TIOCNXCL: {}", device_, std::generic_category().message(errno));
  }
}

std::size_t SerialPort::Read(std::span<std::uint8_t> room) {
  const ssize_t got = read(port_.Get(), room.data(), room.size());
  if (got > 0) return static_cast<std::size_t>(got);
  if (got == 0) throw SerialError(device_, "was hung up", 0);
  if (errno == EAGAIN || errno == EINTR) return 0;
  throw SerialError(device_, "cannot be read", errno);
}

bool SerialPort::HasInput() const {
  pollfd port{port_.Get(), POLLIN, 0};
  return poll(&port, 1, 0) > 0;
}

void SerialPort::Send(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = write(port_.Get(), bytes.data(), bytes.size());
    if (sent >= 0) {
      bytes = bytes.subspan(static_cast<std::size_t>(sent));
      continue;
    }
    if (errno == EINTR) continue;
    if (errno != EAGAIN) throw SerialError(device_, "cannot be written", errno);
    pollfd port{port_.Get(), POLLOUT, 0};
    const int ready = poll(&port, 1, kSendTimeoutMs);
    if (ready == 0) throw SerialError(device_, "takes no bytes", 0);
    if (ready < 0 && errno != EINTR) throw SerialError(device_, "poll", errno);
  }
  while (tcdrain(port_.Get()) != 0) {
    if (errno != EINTR) throw SerialError(device_, "tcdrain", errno);
  }
}

serial_rs485 Rs485Of(const ModbusRtuOptions& options) {
  serial_rs485 settings{};
  settings.flags = SER_RS485_ENABLED | (options.rts_on_send ? SER_RS485_RTS_ON_SEND : SER_RS485_RTS_AFTER_SEND);
  settings.delay_rts_before_send = static_cast<std::uint32_t>(options.rts_before.count());
  settings.delay_rts_after_send = static_cast<std::uint32_t>(options.rts_after.count());
  return settings;
}

std::string Rs485Refused(const serial_rs485& asked, const serial_rs485& taken) {
  constexpr std::uint32_t kPolarity = SER_RS485_RTS_ON_SEND | SER_RS485_RTS_AFTER_SEND;
  if ((taken.flags & SER_RS485_ENABLED) == 0) return "rs485 = true";
  if ((taken.flags & kPolarity) != (asked.flags & kPolarity)) {
    return (asked.flags & SER_RS485_RTS_ON_SEND) != 0 ? "rts_on_send = true" : "rts_on_send = false";
  }
  if (taken.delay_rts_before_send != asked.delay_rts_before_send) {
    return "rts_before, it has " + std::to_string(taken.delay_rts_before_send) + " ms";
  }
  if (taken.delay_rts_after_send != asked.delay_rts_after_send) {
    return "rts_after, it has " + std::to_string(taken.delay_rts_after_send) + " ms";
  }
  return {};
}

}  // namespace granary
