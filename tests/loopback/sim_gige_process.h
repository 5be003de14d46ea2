// granary-sim-gige as a child process that is told what to do.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/modbus/socket.h"

namespace granary {

/// Killed at the end if it still runs.
class SimGigeProcess {
 public:
  /// Starts it with these arguments; returns when its cameras are there or it has ended.
  explicit SimGigeProcess(const std::vector<std::string>& arguments);
  ~SimGigeProcess();
  SimGigeProcess(const SimGigeProcess&) = delete;
  SimGigeProcess& operator=(const SimGigeProcess&) = delete;

  /// One line of its standard input, as "pull left"; returns when it is obeyed, or answered in another way.
  void Tell(const std::string& line);
  /// Sends the signal and waits for the end. @return the exit code; empty when it was killed
  std::optional<int> End(int signal);
  /// Waits for the end. @return as End
  std::optional<int> ExitCode();
  /// What it printed so far, standard error included.
  [[nodiscard]] const std::string& Output() const { return output_; }

 private:
  bool ReadMore();
  /// Reads on until `words` come at `from` or later, or the end.
  void ReadUntil(const std::string& words, std::size_t from);

  pid_t pid_ = -1;
  FileDescriptor in_, out_;
  std::string output_;
};

}  // namespace granary
