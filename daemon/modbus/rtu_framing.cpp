// On a shared line silence is the standard's only mark between frames, and it is the one thing a program cannot see: a
// FIFO or a USB adapter joins frames into one read, and tears one frame into reads that are milliseconds apart. So
// silence only says when to look (t3.5 after the newest byte, when we may speak as well); what is a frame is decided by
// length and checksum. Frames are taken off from the front, because a frame of a neighbour that is known as a whole
// cannot be searched for requests inside its data. Bytes that may be the beginning of a frame get the time that the
// rest needs; those that begin none are noise and dropped one by one.
#include "daemon/modbus/rtu_framing.h"

#include <algorithm>
#include <utility>

namespace granary {
namespace {

using namespace std::chrono_literals;

constexpr std::uint8_t kBroadcast = 0;
constexpr std::uint8_t kLastAddress = 247;

/// A UART's FIFO gives its last bytes away after four characters of silence, a USB adapter after 16 ms (FTDI).
constexpr int kFifoCharacters = 4;
constexpr std::chrono::nanoseconds kAdapterDelay = 20ms;
/// Granted to a frame whose function does not tell its length.
constexpr std::size_t kUnknownRest = 16;
/// Until it is known whether we hear ourselves, a frame equal to our answer is that answer for so long.
constexpr std::chrono::nanoseconds kEchoWindow = 50ms;
/// More than a kernel's buffer holds (4095) has been heard without a silence: nobody sends frames there.
constexpr std::size_t kMaxHeard = 8192;

bool IsFrame(std::span<const std::uint8_t> bytes, std::size_t length) {
  return length >= kMinRtuBytes && length <= kMaxRtuBytes && length <= bytes.size() && Crc16(bytes.first(length)) == 0;
}

bool BeginsWith(std::span<const std::uint8_t> bytes, std::span<const std::uint8_t> beginning) {
  return bytes.size() >= beginning.size() && std::equal(beginning.begin(), beginning.end(), bytes.begin());
}

/// Whether the function is none whose length is known; the third byte tells FC43's kinds apart.
bool IsUnknownFunction(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < 2 || bytes[1] == 0 || bytes[1] >= 0x80) return false;
  return RequestBytes(bytes.first(std::min<std::size_t>(bytes.size(), 3))) == 0;
}

}  // namespace

RtuFraming::RtuFraming(const RtuTiming& timing, std::function<bool(std::uint8_t)> serves, ModbusTally& tally)
    : timing_(timing), serves_(std::move(serves)), tally_(tally) {}

bool RtuFraming::IsOurs(std::uint8_t address) const {
  return address != kBroadcast && address <= kLastAddress && serves_(address);
}

void RtuFraming::Receive(std::span<const std::uint8_t> bytes, Time now) {
  if (bytes.empty()) return;
  if (begin_ == heard_.size()) in_noise_ = false;  // all before was judged in a silence
  heard_.erase(heard_.begin(), heard_.begin() + static_cast<std::ptrdiff_t>(begin_));
  std::erase_if(pauses_, [&](std::size_t place) { return place < begin_; });
  for (std::size_t& place : pauses_) place -= begin_;
  begin_ = 0;

  const std::chrono::nanoseconds on_the_line = timing_.character * static_cast<int>(bytes.size());
  if (!heard_.empty() && now - newest_ - on_the_line > timing_.t15) pauses_.push_back(heard_.size());
  heard_.insert(heard_.end(), bytes.begin(), bytes.end());
  newest_ = now;
  wait_until_.reset();
  if (heard_.size() > kMaxHeard) {
    Drop(heard_.size() - kMaxRtuBytes);
    DropNoise();
  }
}

std::optional<RtuFraming::Time> RtuFraming::Deadline() const {
  if (begin_ == heard_.size()) return std::nullopt;
  return wait_until_.value_or(newest_ + timing_.t35);
}

std::optional<RtuRequest> RtuFraming::Next(Time now) {
  if (now < newest_ + timing_.t35) return std::nullopt;
  while (begin_ < heard_.size()) {
    if (std::binary_search(pauses_.begin(), pauses_.end(), begin_)) in_noise_ = false;
    const auto rest = std::span<const std::uint8_t>(heard_).subspan(begin_);
    const Match match = MatchAt(rest);
    switch (match.found) {
      case Found::kUnfinished: {
        const auto missing = timing_.character * (static_cast<int>(match.bytes) + kFifoCharacters);
        const Time until = newest_ + missing + kAdapterDelay;
        if (now < until && !(in_noise_ && EndsInRequest(rest))) {
          wait_until_ = until;
          return std::nullopt;
        }
        DropNoise();
        break;
      }
      case Found::kNothing:
        DropNoise();
        break;
      case Found::kEcho:
        EndEcho(Echo::kHeard);
        Drop(match.bytes);
        break;
      case Found::kOther:
        ++tally_.rtu_others;
        EndEcho(Echo::kAbsent);
        Drop(match.bytes);
        break;
      case Found::kRequest: {
        EndEcho(Echo::kAbsent);
        RtuRequest request{rest[0], {rest.begin() + 1, rest.begin() + static_cast<std::ptrdiff_t>(match.bytes) - 2}};
        const std::size_t after = rest.size() - match.bytes;
        Drop(match.bytes);
        if (request.address == kBroadcast || after == 0) return request;
        ++tally_.rtu_errors;
        // Too little for a frame is the click of a transceiver that lets go of the line. More means that the master has
        // asked on: it does not wait for us any more, and an answer would run into somebody else's.
        if (after < kMinRtuBytes) {
          Drop(after);
          return request;
        }
        break;
      }
    }
  }
  return std::nullopt;
}

RtuFraming::Match RtuFraming::MatchAt(std::span<const std::uint8_t> rest) const {
  const Match echo = MatchEcho(rest);
  if (echo.found == Found::kEcho) return echo;
  const std::uint8_t address = rest[0];
  if (address > kLastAddress) return {};
  const bool ours = IsOurs(address);
  const bool others = !ours && address != kBroadcast;

  const std::size_t request = RequestBytes(rest);
  if (IsFrame(rest, request)) {
    if (others) return {Found::kOther, request};
    // In the midst of noise only the silence after it tells a request from data that look like one.
    if (!in_noise_ || (ours && request == rest.size())) return {Found::kRequest, request};
  }
  const std::size_t reply = others ? ReplyBytes(rest) : 0;
  if (IsFrame(rest, reply)) return {Found::kOther, reply};
  if (!in_noise_) {
    if (const Match match = MatchBetweenPauses(rest, ours); match.found != Found::kNothing) return match;
  }

  std::size_t missing = echo.bytes;
  for (const std::size_t length : {request, reply}) missing = std::max(missing, length - std::min(length, rest.size()));
  if (!in_noise_ && address != kBroadcast && IsUnknownFunction(rest) && rest.size() < kMaxRtuBytes) {
    missing = std::max(missing, kUnknownRest);
  }
  if (missing == 0) return {};
  return {Found::kUnfinished, missing};
}

RtuFraming::Match RtuFraming::MatchEcho(std::span<const std::uint8_t> rest) const {
  if (sent_.empty()) return {};
  if (rest.size() < sent_.size()) {
    if (BeginsWith(sent_, rest)) return {Found::kUnfinished, sent_.size() - rest.size()};
    return {};
  }
  if (!BeginsWith(rest, sent_)) return {};
  // The answers to FC5, 6 and 22 repeat the request, so what equals one may be the master asking the same again.
  const bool may_be_request = RequestBytes(sent_) == sent_.size();
  const bool too_late = echo_ == Echo::kUnknown && newest_ > echo_until_;
  if (may_be_request && (echo_ == Echo::kAbsent || too_late)) return {};
  return {Found::kEcho, sent_.size()};
}

/// A frame that says nothing about its length, or something else than the standard, is one if it fills the room from
/// here to a pause.
RtuFraming::Match RtuFraming::MatchBetweenPauses(std::span<const std::uint8_t> rest, bool ours) const {
  if (rest[0] == kBroadcast || (ours && !IsUnknownFunction(rest))) return {};
  const Found found = ours ? Found::kRequest : Found::kOther;
  for (const std::size_t pause : pauses_) {
    if (pause > begin_ && IsFrame(rest, pause - begin_)) return {found, pause - begin_};
  }
  if (IsFrame(rest, rest.size())) return {found, rest.size()};
  return {};
}

bool RtuFraming::EndsInRequest(std::span<const std::uint8_t> rest) const {
  for (; rest.size() >= kMinRtuBytes; rest = rest.subspan(1)) {
    if (RequestBytes(rest) == rest.size() && IsOurs(rest[0]) && IsFrame(rest, rest.size())) return true;
  }
  return false;
}

void RtuFraming::Sent(std::span<const std::uint8_t> frame, Time now) {
  heard_.clear();
  pauses_.clear();
  begin_ = 0;
  wait_until_.reset();
  sent_.assign(frame.begin(), frame.end());
  echo_until_ = now + kEchoWindow;
  echo_spoiled_ = false;
}

void RtuFraming::Drop(std::size_t bytes) {
  begin_ += bytes;
  in_noise_ = false;
}

void RtuFraming::DropNoise() {
  if (!in_noise_) ++tally_.rtu_errors;
  ++begin_;
  in_noise_ = true;
  echo_spoiled_ = true;
}

void RtuFraming::EndEcho(Echo learnt) {
  if (sent_.empty()) return;
  // Noise instead of our answer may have been our answer.
  if (learnt == Echo::kHeard || !echo_spoiled_) echo_ = learnt;
  sent_.clear();
}

}  // namespace granary
