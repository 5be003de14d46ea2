// A snapshot is encoded once a second, or once a publication, and every read is a copy out of that image under one
// lock: cheap, and never a mixture. Writes are planned under the lock and done without it, for the control publishes.
#include "daemon/modbus/units.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include <spdlog/fmt/ranges.h>
#include <spdlog/spdlog.h>

#include "daemon/modbus/status.h"

namespace granary {
namespace {

/// Counters of the servers: they change with every request, so they are encoded when they are read.
constexpr int kLiveBegin = 240, kLiveEnd = 300;
constexpr std::chrono::seconds kStageLife{60};

bool ReadsLiveRegisters(std::span<const std::uint8_t> request) {
  if (request.size() < 5) return false;
  const int address = WordAt(request, 1), count = WordAt(request, 3);
  return address < kLiveEnd && address + count > kLiveBegin;
}

Pdu WriteReply(std::span<const std::uint8_t> request) {
  const bool is_many = request[0] == function_code::kWriteCoils || request[0] == function_code::kWriteRegisters;
  const auto echoed = is_many ? request.first(5) : request;
  return {echoed.begin(), echoed.end()};
}

}  // namespace

ModbusUnits::ModbusUnits(ModbusIdentity identity, const std::vector<Bin>& bins, BinControl& control, ModbusTally& tally,
                         std::function<UtcTime()> utc_now, std::function<SteadyTime()> steady_now)
    : identity_(std::move(identity)),
      control_(control),
      tally_(tally),
      utc_now_(utc_now ? std::move(utc_now) : [] { return UtcTime(std::chrono::system_clock::now()); }),
      steady_now_(steady_now ? std::move(steady_now) : [] { return std::chrono::steady_clock::now(); }) {
  if (bins.empty()) throw std::invalid_argument("modbus: no bins to serve");
  for (const auto& bin : bins) {
    auto unmeasured = std::make_shared<BinSnapshot>();
    unmeasured->bin = bin;
    units_.emplace_back().snapshot = std::move(unmeasured);
  }
}

ModbusUnits::~ModbusUnits() = default;

void ModbusUnits::Publish(const BinSnapshot& snapshot) {
  auto next = std::make_shared<const BinSnapshot>(snapshot);  // destroyed, as the one before, when nothing is locked
  const std::scoped_lock lock(mutex_);
  auto same = std::find_if(units_.begin(), units_.end(),
                           [&](const Unit& unit) { return unit.snapshot->bin.id == snapshot.bin.id; });
  if (same == units_.end()) same = units_.emplace(units_.end());
  same->snapshot.swap(next);
  same->encoded.reset();
}

Pdu ModbusUnits::Answer(std::uint8_t unit, std::span<const std::uint8_t> request, const Requester& requester) {
  if (IsWrite(request[0])) return Write(unit, request, requester);
  const Now now = Clocks();
  const std::scoped_lock lock(mutex_);
  Unit* const found = Find(unit);
  if (!found) return ExceptionPdu(request[0], ModbusException::kNoSuchUnit);
  Refresh(*found, now);
  if (ReadsLiveRegisters(request)) {
    EncodeRows(kLiveBegin, kLiveEnd, {*found->snapshot, now.utc, identity_, tally_.Read()}, found->registers);
  }
  return AnswerRequest(request, ViewOf(*found));
}

bool ModbusUnits::Serves(std::uint8_t unit) const {
  const std::scoped_lock lock(mutex_);
  return std::any_of(units_.begin(), units_.end(), [&](const Unit& known) { return known.snapshot->bin.id == unit; });
}

ModbusUnits::Unit* ModbusUnits::Find(std::uint8_t unit) {
  if (unit == 0 || unit == 255) return &units_.front();
  const auto found =
      std::find_if(units_.begin(), units_.end(), [&](const Unit& known) { return known.snapshot->bin.id == unit; });
  return found == units_.end() ? nullptr : &*found;
}

void ModbusUnits::Refresh(Unit& unit, const Now& now) const {
  if (unit.stage && now.steady >= unit.stage->until) {
    unit.stage.reset();
    unit.encoded.reset();
  }
  const auto second = std::chrono::floor<std::chrono::seconds>(now.utc);
  if (unit.encoded == second) return;
  unit.registers = EncodeRegisters({*unit.snapshot, now.utc, identity_, tally_.Read()});
  if (unit.stage) ShowStage(*unit.stage, unit.registers);
  unit.coils = CoilBits(*unit.snapshot);
  unit.encoded = second;
}

UnitView ModbusUnits::ViewOf(const Unit& unit) const {
  return {unit.registers, unit.coils, identity_, unit.snapshot->bin};
}

Pdu ModbusUnits::Write(std::uint8_t unit, std::span<const std::uint8_t> request, const Requester& requester) {
  if (!requester.may_write) {
    ++tally_.writes_refused;
    LogRefusal(request, requester);
    return ExceptionPdu(request[0], ModbusException::kIllegalFunction);
  }
  int bin = 0;
  Task task;
  {
    const Now now = Clocks();
    const std::scoped_lock lock(mutex_);
    Unit* const found = Find(unit);
    if (!found) return ExceptionPdu(request[0], ModbusException::kNoSuchUnit);
    Refresh(*found, now);
    bin = found->snapshot->bin.id;
    task = Prepare(*found, request, requester, now);
  }
  if (const auto* refusal = std::get_if<ModbusException>(&task)) return ExceptionPdu(request[0], *refusal);
  if (const auto* commit = std::get_if<Commit>(&task)) {
    if (const auto faults = Faults(commit->book); !faults.empty()) {
      LogBookFaults(faults, requester);
      return ExceptionPdu(request[0], ModbusException::kIllegalValue);
    }
  }
  if (!Do(task, bin, requester)) return ExceptionPdu(request[0], ModbusException::kBusy);
  ++tally_.writes;
  if (request[0] != function_code::kReadWriteRegisters) return WriteReply(request);
  Pdu reading(request.begin(), request.begin() + 5);
  reading[0] = function_code::kReadHoldingRegisters;
  Pdu reply = Answer(unit, reading, requester);
  reply[0] = static_cast<std::uint8_t>((reply[0] & 0x80) | request[0]);
  return reply;
}

ModbusUnits::Task ModbusUnits::Prepare(Unit& unit, std::span<const std::uint8_t> request, const Requester& requester,
                                       Now now) {
  if (request[0] == function_code::kReadWriteRegisters && request.size() >= 5) {
    const Pdu reply = ReadRegisters(request.first(5), unit.registers);
    if ((reply[0] & 0x80) != 0) return static_cast<ModbusException>(reply[1]);
  }
  const WritePlan plan = PlanWrite(request, *unit.snapshot, unit.registers);
  if (const auto* refusal = std::get_if<ModbusException>(&plan)) return *refusal;
  if (const auto* format = std::get_if<RegisterFormat>(&plan)) return *format;
  if (const auto* command = std::get_if<BinCommand>(&plan)) return *command;
  if (const auto* book = std::get_if<BookWrite>(&plan)) return Stage(unit, *book, requester, now.steady);
  return std::monostate{};
}

ModbusUnits::Task ModbusUnits::Stage(Unit& unit, const BookWrite& write, const Requester& requester, SteadyTime now) {
  const BookState& book = unit.snapshot->book;
  const std::string host(HostOf(requester.name));
  if (book.commit == CommandResult::kBusy || (unit.stage && unit.stage->host != host)) return ModbusException::kBusy;
  const bool writes_words = std::any_of(write.words.begin(), write.words.end(), [](const auto& word) { return word; });
  if (!writes_words && !write.commit) return std::monostate{};
  if (!writes_words && !unit.stage) return ModbusException::kIllegalValue;  // nothing to commit

  BookStage next = unit.stage.value_or(BookStage{host, now, {}});
  if (writes_words) next.until = now + kStageLife;
  for (std::size_t i = 0; i < write.words.size(); ++i) {
    if (write.words[i]) next.words[i] = write.words[i];
  }
  unit.encoded.reset();
  if (!write.commit) {
    unit.stage = std::move(next);
    return std::monostate{};
  }
  const std::optional<BookStage> before = std::exchange(unit.stage, std::nullopt);
  return Commit{BookOf(next.words, book.in_force), before};
}

bool ModbusUnits::Do(const Task& task, int bin, const Requester& requester) {
  const std::string who(requester.name);
  if (const auto* format = std::get_if<RegisterFormat>(&task)) return control_.SetFormat(bin, *format, who);
  if (const auto* command = std::get_if<BinCommand>(&task)) return control_.Ask(bin, *command, who);
  const auto* commit = std::get_if<Commit>(&task);
  if (!commit || control_.CommitBook(bin, commit->book, who)) return true;
  if (commit->before) {  // the client may try again: all is as it was
    const std::scoped_lock lock(mutex_);
    Unit* const unit = Find(static_cast<std::uint8_t>(bin));
    if (unit && !unit->stage) {
      unit->stage = commit->before;
      unit->encoded.reset();
    }
  }
  return false;
}

std::optional<int> ModbusUnits::CountLine(OncePerMinute& log) {
  const SteadyTime now = steady_now_();
  const std::scoped_lock lock(mutex_);
  return log.Count(now);
}

void ModbusUnits::LogRefusal(std::span<const std::uint8_t> request, const Requester& requester) {
  const auto count = CountLine(refused_log_);
  if (!count) return;
  const std::size_t at = request[0] == function_code::kReadWriteRegisters ? 5 : 1;
  const std::string address = request.size() >= at + 2 ? std::to_string(WordAt(request, at)) : "none";
  spdlog::warn(
      "modbus: {} may not write (see write_allow): function {}, address {}; refused ({} since the last such "
      "line)",
      requester.name, request[0], address, *count);
}

void ModbusUnits::LogBookFaults(const std::vector<std::string>& faults, const Requester& requester) {
  const auto count = CountLine(book_log_);
  if (!count) return;
  spdlog::warn("modbus: {}: book data refused: {} ({} since the last such line)", requester.name,
               fmt::join(faults, "; "), *count);
}

}  // namespace granary
