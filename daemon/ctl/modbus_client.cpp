// libmodbus, with its few error numbers turned into words that say what an engineer can look at.
#include "daemon/ctl/modbus_client.h"

#include <modbus/modbus.h>
#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <string>
#include <utility>

namespace granary {
namespace {

constexpr int kMaxRegistersARead = 125;  // Source: MODBUS Application Protocol V1.1b3, 6.3

/// libmodbus calls a name that nobody knows a refused connection.
void CheckName(const HostPort& address) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int fault = getaddrinfo(address.host.c_str(), nullptr, &hints, &found);
  if (fault != 0) throw ModbusClientError(address.host + ": " + gai_strerror(fault));
  freeaddrinfo(found);
}

std::string ReadFault(int error, int unit, bool has_answered) {
  switch (error) {
    case ECONNRESET:
    case EPIPE:
      return has_answered ? "the server closed the connection"
                          : "the server closed the connection; is this computer's address in modbus.tcp.allow?";
    case ETIMEDOUT:
      return "the server does not answer";
    case EMBXGTAR:
      return "exception 0B: no bin of the server has the unit id " + std::to_string(unit);
    default:
      break;
  }
  if (error > MODBUS_ENOBASE && error < EMBBADCRC) {
    char code[24];
    std::snprintf(code, sizeof code, "exception %02X: ", static_cast<unsigned>(error - MODBUS_ENOBASE));
    return code + std::string(modbus_strerror(error));
  }
  return modbus_strerror(error);
}

}  // namespace

void ModbusClient::Free::operator()(_modbus* client) const {
  modbus_close(client);
  modbus_free(client);
}

ModbusClient::ModbusClient(HostPort address, int unit, const std::string& where_from, std::chrono::milliseconds timeout)
    : address_(std::move(address)), unit_(unit) {
  CheckName(address_);
  client_.reset(modbus_new_tcp_pi(address_.host.c_str(), std::to_string(address_.port).c_str()));
  if (!client_) throw ModbusClientError(PrintHostPort(address_) + ": " + modbus_strerror(errno));
  if (modbus_set_slave(client_.get(), unit_) != 0)
    throw ModbusClientError("unit " + std::to_string(unit_) + ": " + modbus_strerror(errno) +
                            "; must be 0 to 247, or 255");
  if (modbus_set_response_timeout(client_.get(), static_cast<std::uint32_t>(timeout.count() / 1000),
                                  static_cast<std::uint32_t>(timeout.count() % 1000 * 1000)) != 0)
    throw ModbusClientError(std::string("response timeout: ") + modbus_strerror(errno));
  if (modbus_connect(client_.get()) != 0) {
    const int error = errno;
    throw ModbusClientError((error == ECONNREFUSED
                                 ? "no Modbus server listens on " + PrintHostPort(address_) + "; is granaryd running?"
                                 : PrintHostPort(address_) + " cannot be reached: " + modbus_strerror(error) + ".") +
                            " The address is " + where_from);
  }
}

std::vector<std::uint16_t> ModbusClient::Read(int first, int count) {
  std::vector<std::uint16_t> words(static_cast<std::size_t>(count));
  for (int done = 0; done < count;) {
    const int part = std::min(kMaxRegistersARead, count - done);
    if (modbus_read_registers(client_.get(), first + done, part, words.data() + done) != part) {
      throw ModbusClientError(PrintHostPort(address_) + ", unit " + std::to_string(unit_) + ", registers " +
                              std::to_string(first + done) + " to " + std::to_string(first + done + part - 1) + ": " +
                              ReadFault(errno, unit_, has_answered_));
    }
    has_answered_ = true;
    done += part;
  }
  return words;
}

}  // namespace granary
