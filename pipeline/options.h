// How the pipeline measures. Every option has a default that suits a speckle-lit bin; see docs/configuration.md.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace granary {

/// Census + semi-global matching (METHOD §3).
struct StereoOptions {
  int census_width = 9;      ///< odd, 3…9
  int census_height = 7;     ///< odd, 3…7
  int p1 = 10;               ///< penalty for a disparity step of one, in census bits
  int p2 = 60;               ///< penalty for a larger step; more than p1
  bool adaptive_p2 = false;  ///< the paper's P2' / |grey gradient|, P2' = 20·p2, no more than p2; worse on speckle
  int median_px = 0;         ///< window of the median over either picture's winners: 0 (none), 3 or 5
  int left_right_px = 1;     ///< largest disagreement of the left–right check
  double uniqueness = 0.01;  ///< second-best sum must exceed the best by this share
  int speckle_area_px = 60;  ///< connected disparity blobs smaller than this are removed; 0 keeps all
  int refine_radius_px = 6;  ///< half window of the least-squares refinement; 0 switches it off
  /// Search near what pictures of half the size show; saves time and memory on large pictures with many disparities.
  bool coarse_to_fine = false;
  int max_disparities = 256;  ///< most disparities searched; limits how near to the cameras grain is seen
};

/// Cloud to volume (METHOD §5, §6).
struct SurfaceOptions {
  /// Points nearer to the empty bin than this are scene; empty: from the depth noise at the floor.
  std::optional<double> segment_distance_m;
  /// Longest edge of a triangle; empty: from the measured point spacing.
  std::optional<double> edge_threshold_m;
  double min_coverage = 0.6;       ///< below this share of the floor the figure is invalid
  double reduced_coverage = 0.85;  ///< below this share it is marked as of reduced accuracy
};

/// When a picture is too poor to be measured.
struct QualityOptions {
  double min_mean_fraction = 0.01;       ///< mean grey as a share of full scale
  double max_saturated_fraction = 0.10;  ///< share of full pixels inside the footprint
  double min_speckle_contrast = 0.05;    ///< local standard deviation over local mean
};

struct PipelineOptions {
  StereoOptions stereo;
  SurfaceOptions surface;
  QualityOptions quality;
};

/// What is wrong with the options: one "key: what, what is allowed" each; empty when all is well.
[[nodiscard]] std::vector<std::string> Faults(const StereoOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const SurfaceOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const QualityOptions& options);

}  // namespace granary
