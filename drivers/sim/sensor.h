// From light to grey values: exposure, gain, noise, quantisation.
#pragma once

#include <cstdint>

#include <opencv2/core/mat.hpp>

namespace granary {

/// How a simulated camera is set.
struct SimExposure {
  double exposure_us = 8000;
  double gain_db = 0;
};

/// What the chip itself adds.
struct SimChip {
  double full_well_e = 9000;  ///< electrons at full scale and 0 dB
  double read_noise_e = 12;   ///< standard deviation, electrons
};

/// An 8-bit linear picture of the light. Equal keys give equal noise, whatever the number of threads.
/// @param light CV_32FC1, share of full scale at 8000 µs and 0 dB
[[nodiscard]] cv::Mat Expose(const cv::Mat& light, const SimExposure& exposure, const SimChip& chip,
                             std::uint64_t noise_key);

}  // namespace granary
