// Telling grain from the scene it lies in (METHOD §5), on clouds in the world frame.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// Which points belong to the scene: those within `distance_m` of the nearest point of the empty bin ("improved
/// Euclidean clustering"). Grain is what is left. Every point is decided on, nothing is downsampled, and the answer is
/// that of comparing every pair of points: `|p − q|² ≤ distance²`, evaluated in double.
///
/// Runs in parallel; the result does not depend on the number of threads. Points in picture order are fastest.
/// Source: Zhao 2023, §5.1.
/// @param points, empty_bin metres; a point with a coordinate that is not finite is never scene and makes none
/// @return one flag a point: 1 scene, 0 not
/// @throws std::invalid_argument for a distance that is negative, NaN or infinite, or for 2^32 points or more
[[nodiscard]] std::vector<std::uint8_t> FindScenePoints(std::span<const Eigen::Vector3f> points,
                                                        std::span<const Eigen::Vector3f> empty_bin, double distance_m);

/// Pass-through filter along one axis: 1 where min ≤ coordinate ≤ max, 0 elsewhere and where any coordinate of the
/// point is not finite. Source: Zhao 2023, §5.2 (PCL's PassThrough).
/// @throws std::invalid_argument when a limit is NaN or min exceeds max
[[nodiscard]] std::vector<std::uint8_t> PassThroughX(std::span<const Eigen::Vector3f> points, float min_x_m,
                                                     float max_x_m);
[[nodiscard]] std::vector<std::uint8_t> PassThroughY(std::span<const Eigen::Vector3f> points, float min_y_m,
                                                     float max_y_m);
[[nodiscard]] std::vector<std::uint8_t> PassThroughZ(std::span<const Eigen::Vector3f> points, float min_z_m,
                                                     float max_z_m);

/// Stray points: 1 where fewer than `min_neighbours` other points lie within `radius_m`, or where a coordinate is not
/// finite (PCL's RadiusOutlierRemoval).
/// @throws std::invalid_argument when the radius is not above 0 or `min_neighbours` is below 1
[[nodiscard]] std::vector<std::uint8_t> FindOutliers(std::span<const Eigen::Vector3f> points, double radius_m,
                                                     int min_neighbours);

/// A plane a·x + b·y + c·z + d = 0 with unit normal (a, b, c), c > 0; metres.
struct FloorPlane {
  Eigen::Vector4d coefficients;
  double inlier_share = 0;  ///< of the finite points, those within the tolerance
};

/// The largest nearly level plane in the points: RANSAC over an even sample of them (PCL's SACSegmentation with its
/// fixed seed), then least squares over all points within the tolerance. The same points give the same plane.
/// @param points metres; points that are not finite are left out
/// @param tolerance_m a point within this distance of the plane supports it
/// @return empty when there are fewer than three points or no plane within 10° of level
/// @throws std::invalid_argument when the tolerance is not above 0
[[nodiscard]] std::optional<FloorPlane> FitFloorPlane(std::span<const Eigen::Vector3f> points, double tolerance_m);

}  // namespace granary
