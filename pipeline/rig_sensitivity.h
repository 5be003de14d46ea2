// How far a volume may be off because calibration and pose are known only so well.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "pipeline/types/calibration.h"
#include "pipeline/types/transform.h"

namespace granary {

/// A patch of the grain's surface and the floor under it; a few hundred stand for a bin.
struct SurfaceSample {
  Eigen::Vector3d grain_in_world = Eigen::Vector3d::Zero();  ///< m
  Eigen::Vector2d grain_slope = Eigen::Vector2d::Zero();     ///< ∂z/∂x, ∂z/∂y
  double floor_z_m = 0;                                      ///< at the same x and y
  Eigen::Vector2d floor_slope = Eigen::Vector2d::Zero();
  double area_m2 = 0;  ///< on the floor plane
};

/// What the heights of the floor are.
enum class FloorSource {
  kMeasured,  ///< the empty bin as this very rig saw it: its errors go with those of the grain
  kPose,      ///< z = 0, whatever the rig is like
};

/// What the pose has to do with the calibration.
enum class PoseOrigin {
  kIndependent,           ///< nothing: the rig's place in the world stays what it is
  kFoundWithCalibration,  ///< it fits the floor's places to the left picture by this very calibration
};

/// Standard deviations of one volume (k = 1).
struct RigDeviation {
  double calibration_m3 = 0;
  double pose_m3 = 0;
};

// What a pose found with care is worth: standard deviations for each axis, independent of each other. Its corners or
// planes are seen to a few tenths of a pixel, and pictures have some 1500 px for a width as large as the distance: that
// is 0.2e-3 of the distance, and tilts are that over the half width of the floor, about two thirds of the distance.
// Another half pixel and more (0.37e-3) is what rays and mount shift between the pose and the measurement: with
// temperature, or because the calibration is of another day.
inline constexpr double kPoseShift = 0.42e-3;  ///< of the camera's height above the floor
inline constexpr double kPoseTurn_rad = 0.3e-3;

// What the calibration of a pair from 10 or more good views of a board is worth where no covariance is stored: six
// errors, independent of each other. They are those of simulated calibrations of the rig over the paper's box: 16 views
// of 9×6 corners, 0.1 px of noise on each (tests/bench/uncertainty_coverage --modes). There scale and offset go against
// each other (1.0e-3 and 0.09 px, correlation −0.8); these two, independent, give the same volumes. Corners are found
// to pixels, so pixels carry over to other rigs.
inline constexpr double kDepthScale = 5.5e-4;        ///< the same share of every depth
inline constexpr double kDisparityOffset_px = 0.05;  ///< the same everywhere
inline constexpr double kDisparitySlope_px = 0.05;   ///< from left edge to right; from upper edge to lower
inline constexpr double kPrincipalPoint_px = 1.0;    ///< all rays turned about the left camera; its x and its y
/// Share of the camera's height by which the floor of a pose found with the calibration misses the floor that the pair
/// triangulates. The two errors above come almost together in both.
inline constexpr double kFoundFloor = 1e-4;

/// To first order, after the GUM (JCGM 100:2008, 5.1 and 5.2): the volume's change for one standard deviation along
/// each independent direction of what is uncertain, squares summed.
///
/// A feature keeps its place in the raw pictures. With another calibration it is rectified and triangulated to another
/// point, by the disparity of its columns as the matcher has it; with another pose the point moves as a whole. The
/// height at a fixed place then changes by `δz − slope·δxy`. Turns of the pose are about the middle of the floor, where
/// tilt and height of a plane found from the floor are independent.
///
/// A pose that was found with the calibration takes most of the errors of the rays upon itself: what is left is how
/// they differ between grain and floor. Errors of depth stay.
///
/// Samples that are not in both pictures are measured by no one: the others stand for their area.
/// @param calibration with its covariance, or without: then the default above
/// @throws std::invalid_argument when no sample is in both pictures, when a covariance does not fit its calibration,
/// and
///   what RectifyCameras refuses
[[nodiscard]] RigDeviation VolumeDeviation(const std::vector<SurfaceSample>& samples,
                                           const StereoCalibration& calibration, const RigidTransform& world_from_left,
                                           FloorSource floor, PoseOrigin pose = PoseOrigin::kIndependent);

}  // namespace granary
