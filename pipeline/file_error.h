// How files say what is wrong with them.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

namespace granary {

/// A file that cannot be read, written or believed: `FILE: what is wrong, what is allowed`.
class FileError : public std::runtime_error {
 public:
  FileError(const std::filesystem::path& file, const std::string& fault)
      : std::runtime_error(file.string() + ": " + fault), file_(file) {}
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_;
};

}  // namespace granary
