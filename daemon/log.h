// Where log lines go.
#pragma once

#include <string>

namespace granary {

/// True when standard output is the journal's own stream.
[[nodiscard]] bool StdoutIsJournal();

/// All lines to standard output: with time and level for a person, with "<N>" priorities and no time for the journal.
void SetUpLog();

/// @param level trace | debug | info | warn | error
void SetLogLevel(const std::string& level);

/// The last words of a process that cannot start: one line on standard error, as an error for the journal too.
void PrintFatal(const std::string& words);

}  // namespace granary
