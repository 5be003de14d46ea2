// Runs granaryctl as its users do and keeps what it printed.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/pipeline/temporary_folder.h"

namespace granary {

struct ProgramRun {
  int exit_code = -1;  ///< −1 when it did not end by itself
  std::string out, err;
  /// The one JSON document on standard output; a failure, and null, when there is not exactly one.
  [[nodiscard]] nlohmann::json Document() const {
    auto document = nlohmann::json::parse(out, nullptr, false);
    EXPECT_FALSE(document.is_discarded()) << "no single JSON document: " << out;
    return document;
  }
};

/// A folder for the run, its state kept in STATE inside it.
class CtlFolder : public TemporaryFolder {
 public:
  /// @param arguments as typed in a shell that stands in this folder
  /// @param environment further variables, "NAME=value"
  [[nodiscard]] ProgramRun Run(const std::string& arguments, const std::string& environment = "") const {
    const std::string command = "cd '" + path().string() + "' && STATE_DIRECTORY='" + (*this / "state").string() +
                                "' " + environment + " " + GRANARYCTL + " " + arguments + " >out.txt 2>err.txt";
    const int status = std::system(command.c_str());
    ProgramRun run;
    if (WIFEXITED(status)) run.exit_code = WEXITSTATUS(status);
    run.out = Read(*this / "out.txt");
    run.err = Read(*this / "err.txt");
    return run;
  }
};

}  // namespace granary
