// stereo.yml and world.yml (OpenCV FileStorage).
#pragma once

#include <filesystem>

#include "pipeline/types/calibration.h"
#include "pipeline/types/transform.h"

namespace granary {

/// Reads `image_width image_height K1 D1 K2 D2 R T` and, where there is one, `covariance` (see StereoCalibration).
/// @throws FileError naming the file, the key and what is allowed: a missing file or key, no YAML, a wrong shape,
///   a value that is not finite, D not of 4, 5, 8, 12 or 14 coefficients, K no camera matrix, R no rotation within
///   1e-4, T = 0, a covariance of another size than D1 and D2 ask for, or one that is no covariance within 1e-4.
[[nodiscard]] StereoCalibration LoadStereoCalibration(const std::filesystem::path& file);
/// Writes what LoadStereoCalibration reads, bit for bit; replaced whole or not at all. No covariance, no such key.
/// @throws FileError
void SaveStereoCalibration(const std::filesystem::path& file, const StereoCalibration& calibration);

/// Reads `T_world_left`, the pose of the (unrectified) left camera: `X_world = T_world_left · X_left`, metres.
/// @throws FileError naming the file, the key and what is allowed, also when the matrix is not rigid within 1e-4.
[[nodiscard]] RigidTransform LoadWorldFromLeft(const std::filesystem::path& file);
/// Writes what LoadWorldFromLeft reads. @throws FileError
void SaveWorldFromLeft(const std::filesystem::path& file, const RigidTransform& world_from_left);

}  // namespace granary
