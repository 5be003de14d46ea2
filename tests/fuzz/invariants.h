// What the fuzz targets share: how they fail, and bins that obey whatever is asked of them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>

#include "daemon/control.h"
#include "daemon/modbus/answer.h"
#include "daemon/modbus/framing.h"
#include "daemon/modbus/units.h"
#include "daemon/snapshot.h"

namespace granary::fuzz {

/// Ends the process where a fuzzer notices, also with NDEBUG.
inline void Require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", what);
  std::abort();
}

/// One bin that does at once what it is asked and publishes it before it returns, as the daemon's does. One thread.
class ObedientControl : public BinControl {
 public:
  bool ready = true;             ///< false refuses everything
  BinSnapshot snapshot;          ///< as published last
  std::uint64_t effects = 0;     ///< calls that took effect
  ModbusUnits* units = nullptr;  ///< to be set before use

  bool Ask(int bin, BinCommand command, const std::string& who) override {
    CheckCall(bin, who);
    Require(command <= BinCommand::kRelease, "only commands that exist are asked for");
    if (!ready) return false;
    snapshot.command = {command, command == BinCommand::kNone ? CommandResult::kIdle : CommandResult::kDone};
    if (command == BinCommand::kInhibit) snapshot.maintenance = true;
    if (command == BinCommand::kRelease) snapshot.maintenance = false;
    return Publish();
  }
  bool CommitBook(int bin, const BookData& book, const std::string& who) override {
    CheckCall(bin, who);
    Require(Faults(book).empty(), "only good book data are committed");
    Require(snapshot.book.writable, "book data are committed only where clients may write them");
    if (!ready) return false;
    snapshot.book.in_force = WithBook(snapshot.book.in_force, book);
    snapshot.book.commit = CommandResult::kDone;
    return Publish();
  }
  bool SetFormat(int bin, const RegisterFormat& format, const std::string& who) override {
    CheckCall(bin, who);
    Require(static_cast<int>(format.byte_order) <= 3 && static_cast<int>(format.invalid) <= 2,
            "only formats that exist are chosen");
    if (!ready) return false;
    snapshot.format = format;
    return Publish();
  }

 private:
  void CheckCall(int bin, const std::string& who) const {
    Require(bin == snapshot.bin.id && !who.empty(), "a write names its bin and who asked");
  }
  bool Publish() {
    ++effects;
    units->Publish(snapshot);
    return true;
  }
};

/// What every reply obeys, whatever was asked. @param request function code and data
inline void CheckReply(std::span<const std::uint8_t> request, const Pdu& reply) {
  const auto word = [&](std::size_t index) { return (request[index] << 8) | request[index + 1]; };
  Require(!reply.empty() && reply.size() <= kMaxPduBytes, "a reply has 1 to 253 bytes");
  const std::uint8_t function = request[0];
  if (reply[0] != function || (function & 0x80) != 0) {
    Require(reply.size() == 2 && reply[0] == (function | 0x80), "a reply is for its function, or an exception");
    Require(reply[1] == 1 || reply[1] == 2 || reply[1] == 3 || reply[1] == 6 || reply[1] == 0x0B,
            "an exception is one of those in the manual");
    return;
  }
  switch (function) {
    case 1:
    case 2:
      Require(
          request.size() == 5 && word(3) >= 1 && reply.size() == 2 + (word(3) + 7u) / 8 && reply[1] == reply.size() - 2,
          "as many bits as asked for");
      return;
    case 3:
    case 4:
      Require(request.size() == 5 && word(1) + word(3) <= 4000 && reply.size() == 2 + 2u * word(3) &&
                  reply[1] == reply.size() - 2,
              "as many registers as asked for");
      return;
    case 5:
    case 6:
    case 22:
      Require(std::equal(request.begin(), request.end(), reply.begin(), reply.end()), "a write is echoed");
      return;
    case 15:
    case 16:
      Require(request.size() > 5 && reply.size() == 5 && std::equal(reply.begin(), reply.end(), request.begin()),
              "a write of several answers address and quantity");
      return;
    case 23:
      Require(request.size() > 9 && reply.size() == 2 + 2u * word(3) && reply[1] == reply.size() - 2,
              "as many registers as asked for with a write");
      return;
    case 17:
    case 43:
      return;
    default:
      Require(false, "a function that is not served gets an exception");
  }
}

}  // namespace granary::fuzz
