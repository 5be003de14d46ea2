// The journal stamps lines itself and reads their priority from a "<N>" in front (sd-daemon(3)).
#include "daemon/log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string_view>
#include <utility>

namespace granary {
namespace {

/// True when the descriptor is the stream that $JOURNAL_STREAM names ("device:inode"); it may be inherited by a
/// process whose output was redirected since.
bool IsJournal(int descriptor) {
  const char* const stream = std::getenv("JOURNAL_STREAM");
  struct stat info {};
  if (stream == nullptr || fstat(descriptor, &info) != 0) return false;
  return std::to_string(info.st_dev) + ":" + std::to_string(info.st_ino) == stream;
}

/// "%*" in a pattern: the syslog priority of the line.
class PriorityFlag : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& out) override {
    static constexpr std::array<std::string_view, 7> kPriorities{"<7>", "<7>", "<6>", "<4>", "<3>", "<2>", "<7>"};
    const std::string_view priority = kPriorities.at(static_cast<std::size_t>(message.level));
    out.append(priority.data(), priority.data() + priority.size());
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<PriorityFlag>();
  }
};

}  // namespace

bool StdoutIsJournal() { return IsJournal(STDOUT_FILENO); }

void SetUpLog() {
  spdlog::sink_ptr sink;
  if (StdoutIsJournal()) {
    sink = std::make_shared<spdlog::sinks::stdout_sink_mt>();
    auto formatter = std::make_unique<spdlog::pattern_formatter>();
    formatter->add_flag<PriorityFlag>('*').set_pattern("%*%v");
    sink->set_formatter(std::move(formatter));
  } else {
    sink = std::make_shared<spdlog::sinks::stdout_color_sink_mt>();
    sink->set_pattern("%Y-%m-%d %H:%M:%S.%e %^%-5l%$ %v");
  }
  auto logger = std::make_shared<spdlog::logger>("granaryd", std::move(sink));
  // Lines are few and somebody may be following them through a pipe.
  logger->flush_on(spdlog::level::trace);
  spdlog::set_default_logger(std::move(logger));
}

void SetLogLevel(const std::string& level) {
  spdlog::set_level(spdlog::level::from_str(level == "warn" ? "warning" : level));
}

void PrintFatal(const std::string& words) {
  std::cerr << (IsJournal(STDERR_FILENO) ? "<3>" : "") << "granaryd: " << words << std::endl;
}

}  // namespace granary
