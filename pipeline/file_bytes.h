// Whole files in and out: what every format of ours is read from and written through.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace granary {

/// The bytes of `file`. @throws FileError when it is missing, no plain file, unreadable or empty.
[[nodiscard]] std::string ReadBytes(const std::filesystem::path& file);

/// Writes `bytes` so that `file` is at every moment, also across a power cut, either as before or whole: temporary name
/// in the same folder, fsync, rename. The folder has to exist.
/// @throws FileError naming the operation and the system's own words; no temporary file is left behind.
void WriteBytes(const std::filesystem::path& file, std::string_view bytes);

/// Makes `folder` and those above it; one that is there already stays as it is. @throws FileError naming it
void MakeFolder(const std::filesystem::path& folder);

}  // namespace granary
