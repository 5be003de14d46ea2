// The stored reference of a rig: the empty bin's cloud with its noise, id, hash and time.
//
// FOLDER/reference.json names the current version; FOLDER/<id>/ holds each version ever taken (reference.pcd and its
// own reference.json), so that an old one can be loaded or put back. The switch to a new version is one rename.
#pragma once

#include <filesystem>
#include <string>

#include "pipeline/reference.h"

namespace granary {

/// STATE/reference/bin<ID>/<rig>. @throws std::invalid_argument for a rig name that is no plain folder name
[[nodiscard]] std::filesystem::path ReferenceFolder(const std::filesystem::path& state_folder, int bin_id,
                                                    const std::string& rig);
/// True when a reference was stored in `folder` (it may still turn out to be damaged).
/// @throws FileError when the folder may not be read
[[nodiscard]] bool HasReference(const std::filesystem::path& folder);
/// The current version of `folder`, or the version whose own folder (FOLDER/<id>) is given.
/// @throws FileError when there is none, or when it is damaged: the points must have the hash they were stored with.
[[nodiscard]] Reference LoadReference(const std::filesystem::path& folder);
/// Makes `reference` the current version of `folder`, which is created when absent; older versions stay.
/// @throws FileError; the version current before stays current then
void SaveReference(const Reference& reference, const std::filesystem::path& folder);

}  // namespace granary
