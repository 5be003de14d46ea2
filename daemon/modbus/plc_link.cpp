// libmodbus speaks the protocol; the socket is made here. Its own connect would wait out the timeout for every address
// of a name and cannot be interrupted, and looking a name up has no limit at all.
#include "daemon/modbus/plc_link.h"

#include <cerrno>
#include <cstring>
#include <future>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include <netdb.h>
#include <poll.h>
#include <sys/select.h>
#include <sys/socket.h>

namespace granary {
namespace {

using std::chrono::milliseconds;
using Steady = std::chrono::steady_clock;

struct Address {
  sockaddr_storage storage{};
  socklen_t size = 0;
};

struct Lookup {
  int error = 0;  ///< getaddrinfo's, 0 none
  std::vector<Address> addresses;
};

Lookup LookUp(const HostPort& plc, int flags) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = flags | AI_NUMERICSERV;
  addrinfo* list = nullptr;
  Lookup lookup;
  lookup.error = getaddrinfo(plc.host.c_str(), std::to_string(plc.port).c_str(), &hints, &list);
  if (lookup.error != 0) return lookup;
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owned(list, &freeaddrinfo);
  for (const addrinfo* entry = list; entry != nullptr; entry = entry->ai_next) {
    Address address{.size = entry->ai_addrlen};
    std::memcpy(&address.storage, entry->ai_addr, entry->ai_addrlen);
    lookup.addresses.push_back(address);
  }
  return lookup;
}

std::vector<Address> Resolve(const HostPort& plc, milliseconds timeout) {
  Lookup lookup = LookUp(plc, AI_NUMERICHOST);
  if (lookup.error != 0) {
    // A dead name server holds getaddrinfo for half a minute, and nothing ends it: it is left to itself.
    std::packaged_task<Lookup()> task([plc] { return LookUp(plc, AI_ADDRCONFIG); });
    auto result = task.get_future();
    std::thread(std::move(task)).detach();
    if (result.wait_for(timeout) != std::future_status::ready) {
      throw PlcLinkError("the name server gave no address within " + std::to_string(timeout.count()) + " ms");
    }
    lookup = result.get();
  }
  if (lookup.error != 0) throw PlcLinkError(std::string("no address for this name: ") + gai_strerror(lookup.error));
  return lookup.addresses;
}

std::string Words(int error) { return std::generic_category().message(error); }

/// Waits for a connect in progress. @return its errno, 0 when connected
int FinishConnect(int socket, Steady::time_point deadline, const std::stop_token& stop) {
  // A shutdown ends the poll below; when the stop came before, it is made here and now.
  const std::stop_callback interrupt(stop, [socket] { shutdown(socket, SHUT_RDWR); });
  for (;;) {
    pollfd ready{socket, POLLOUT, 0};
    const auto left = std::chrono::ceil<milliseconds>(deadline - Steady::now());
    const int count = left.count() <= 0 ? 0 : poll(&ready, 1, static_cast<int>(left.count()));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw std::system_error(errno, std::generic_category(), "poll");
    if (stop.stop_requested()) return ECANCELED;
    if (count == 0) return ETIMEDOUT;
    int error = 0;
    socklen_t size = sizeof error;
    if (getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &size) != 0) {
      throw std::system_error(errno, std::generic_category(), "getsockopt SO_ERROR");
    }
    return error;
  }
}

FileDescriptor Connect(const HostPort& plc, milliseconds timeout, const std::stop_token& stop) {
  const std::vector<Address> addresses = Resolve(plc, timeout);
  const auto deadline = Steady::now() + timeout;
  std::string cause = "no address";
  for (std::size_t i = 0; i < addresses.size(); ++i) {
    FileDescriptor socket(
        ::socket(addresses[i].storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP));
    if (socket.Get() < 0) throw std::system_error(errno, std::generic_category(), "socket");
    // libmodbus waits with select(), which writes past its set for a higher descriptor.
    if (socket.Get() >= FD_SETSIZE) throw PlcLinkError("too many files are open");
    int error = 0;
    if (connect(socket.Get(), reinterpret_cast<const sockaddr*>(&addresses[i].storage), addresses[i].size) != 0) {
      // One silent address must leave time for the next.
      const auto share = (deadline - Steady::now()) / static_cast<int>(addresses.size() - i);
      error = errno == EINPROGRESS ? FinishConnect(socket.Get(), Steady::now() + share, stop) : errno;
    }
    if (error == 0) return socket;
    cause = error == ETIMEDOUT ? "no answer within " + std::to_string(timeout.count()) + " ms" : Words(error);
  }
  throw PlcLinkError("cannot connect: " + cause);
}

const char* MeaningOf(int exception) {
  switch (exception) {
    case MODBUS_EXCEPTION_ILLEGAL_FUNCTION:
      return "illegal function: the PLC does not serve this function";
    case MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS:
      return "illegal data address: the PLC has no such holding registers";
    case MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE:
      return "illegal data value: the PLC does not take so many registers, or these values";
    case MODBUS_EXCEPTION_SLAVE_OR_SERVER_FAILURE:
      return "server device failure";
    case MODBUS_EXCEPTION_ACKNOWLEDGE:
      return "acknowledge: the PLC needs longer";
    case MODBUS_EXCEPTION_SLAVE_OR_SERVER_BUSY:
      return "server device busy";
    case MODBUS_EXCEPTION_NEGATIVE_ACKNOWLEDGE:
      return "negative acknowledge";
    case MODBUS_EXCEPTION_MEMORY_PARITY:
      return "memory parity error";
    case MODBUS_EXCEPTION_GATEWAY_PATH:
      return "gateway path unavailable";
    case MODBUS_EXCEPTION_GATEWAY_TARGET:
      return "gateway target device failed to respond: is the unit id right?";
    default:
      return "not defined";
  }
}

modbus_t* NewContext(const HostPort& plc, int socket, int unit, milliseconds timeout) {
  modbus_t* context = modbus_new_tcp_pi(plc.host.c_str(), std::to_string(plc.port).c_str());
  if (context == nullptr) throw PlcLinkError(std::string("libmodbus: ") + modbus_strerror(errno));
  const auto whole = static_cast<std::uint32_t>(timeout.count() / 1000);
  const auto rest = static_cast<std::uint32_t>(timeout.count() % 1000 * 1000);
  // Without a timeout from byte to byte the one for the answer holds for all of it, also for one that drips.
  if (modbus_set_slave(context, unit) != 0 || modbus_set_response_timeout(context, whole, rest) != 0 ||
      modbus_set_byte_timeout(context, 0, 0) != 0 || modbus_set_socket(context, socket) != 0) {
    const std::string words = modbus_strerror(errno);
    modbus_free(context);
    throw PlcLinkError("libmodbus: " + words);
  }
  return context;
}

}  // namespace

PlcLink::PlcLink(const HostPort& plc, int unit, milliseconds timeout, const std::stop_token& stop)
    : timeout_(timeout),
      socket_(Connect(plc, timeout, stop)),
      context_(NewContext(plc, socket_.Get(), unit, timeout)),
      interrupt_(stop, [socket = socket_.Get()] { shutdown(socket, SHUT_RDWR); }) {}

void PlcLink::Write(int address, std::span<const std::uint16_t> words) {
  const int count = static_cast<int>(words.size());
  if (modbus_write_registers(context_.get(), address, count, words.data()) != count) {
    Fail(errno, "write", address, count);
  }
}

std::vector<std::uint16_t> PlcLink::Read(int address, int count) {
  std::vector<std::uint16_t> words(static_cast<std::size_t>(count));
  if (modbus_read_registers(context_.get(), address, count, words.data()) != count) {
    Fail(errno, "read", address, count);
  }
  return words;
}

bool PlcLink::WasClosed() const {
  char byte = 0;
  const ssize_t got = recv(socket_.Get(), &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  if (got > 0) throw PlcLinkError("the PLC has sent what nobody asked for");
  return got == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
}

void PlcLink::Fail(int error, const char* verb, int address, int count) const {
  const std::string asked = std::string(verb) + " of holding registers " + std::to_string(address) + " to " +
                            std::to_string(address + count - 1);
  const int exception = error - MODBUS_ENOBASE;
  if (exception >= MODBUS_EXCEPTION_ILLEGAL_FUNCTION && exception < MODBUS_EXCEPTION_MAX) {
    throw PlcRefusal(asked + " refused with exception " + (exception < 10 ? "0" : "") + std::to_string(exception) +
                         ", " + MeaningOf(exception),
                     exception <= MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE);
  }
  // Reset instead of closed: otherwise the kernel would go on sending this request, and a PLC that comes back after an
  // outage could take it after a newer one. When it fails, the close is an ordinary one.
  const linger reset{.l_onoff = 1, .l_linger = 0};
  static_cast<void>(setsockopt(socket_.Get(), SOL_SOCKET, SO_LINGER, &reset, sizeof reset));
  if (error == ETIMEDOUT) throw PlcLinkError(asked + ": no answer within " + std::to_string(timeout_.count()) + " ms");
  if (error == ECONNRESET || error == EPIPE) throw PlcLinkError(asked + ": the PLC has closed the connection");
  if (error >= MODBUS_ENOBASE) throw PlcLinkError(asked + ": the answer is no Modbus: " + modbus_strerror(error));
  throw PlcLinkError(asked + ": " + Words(error));
}

}  // namespace granary
