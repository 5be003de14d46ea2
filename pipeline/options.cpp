#include "pipeline/options.h"

namespace granary {

std::vector<std::string> Faults(const StereoOptions& options) {
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(options.census_width >= 3 && options.census_width <= 9 && options.census_width % 2 == 1,
          "census_width: must be 3, 5, 7 or 9");
  require(options.census_height >= 3 && options.census_height <= 7 && options.census_height % 2 == 1,
          "census_height: must be 3, 5 or 7");
  require(options.p1 >= 1 && options.p1 <= 100, "p1: must be 1 to 100");
  require(options.p2 > options.p1 && options.p2 <= 1000, "p2: must be more than p1 and at most 1000");
  require(options.median_px == 0 || options.median_px == 3 || options.median_px == 5, "median_px: must be 0, 3 or 5");
  require(options.left_right_px >= 0 && options.left_right_px <= 10, "left_right_px: must be 0 to 10");
  require(options.uniqueness >= 0 && options.uniqueness < 1, "uniqueness: must be at least 0 and below 1");
  require(options.speckle_area_px >= 0, "speckle_area_px: must not be negative");
  require(options.refine_radius_px >= 0 && options.refine_radius_px <= 15, "refine_radius_px: must be 0 to 15");
  require(options.max_disparities >= 16 && options.max_disparities <= 2047, "max_disparities: must be 16 to 2047");
  return faults;
}

std::vector<std::string> Faults(const SurfaceOptions& options) {
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(!options.segment_distance_m || *options.segment_distance_m > 0, "segment_distance_m: must be more than 0");
  require(!options.edge_threshold_m || *options.edge_threshold_m > 0, "edge_threshold_m: must be more than 0");
  require(options.min_coverage >= 0 && options.min_coverage <= 1, "min_coverage: must be 0 to 1");
  require(options.reduced_coverage >= options.min_coverage && options.reduced_coverage <= 1,
          "reduced_coverage: must be min_coverage to 1");
  return faults;
}

std::vector<std::string> Faults(const QualityOptions& options) {
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(options.min_mean_fraction >= 0 && options.min_mean_fraction < 1,
          "min_mean_fraction: must be at least 0 and below 1");
  require(options.max_saturated_fraction > 0 && options.max_saturated_fraction <= 1,
          "max_saturated_fraction: must be more than 0 and at most 1");
  require(options.min_speckle_contrast >= 0 && options.min_speckle_contrast < 1,
          "min_speckle_contrast: must be at least 0 and below 1");
  return faults;
}

}  // namespace granary
