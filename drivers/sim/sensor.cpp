// Each pixel's noise is a hash of its key and place. Shot noise is taken as normal, true enough beyond ten electrons.
#include "drivers/sim/sensor.h"

#include <algorithm>
#include <cmath>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "drivers/sim/hash.h"

namespace granary {

cv::Mat Expose(const cv::Mat& light, const SimExposure& exposure, const SimChip& chip, std::uint64_t noise_key) {
  constexpr double kReferenceExposure_us = 8000;
  cv::Mat image(light.size(), CV_8UC1);
  const auto to_electrons = static_cast<float>(exposure.exposure_us / kReferenceExposure_us * chip.full_well_e);
  const auto to_grey = static_cast<float>(std::pow(10.0, exposure.gain_db / 20) * 255 / chip.full_well_e);
  const auto read_variance = static_cast<float>(chip.read_noise_e * chip.read_noise_e);
  const auto full_well = static_cast<float>(chip.full_well_e);
  tbb::parallel_for(tbb::blocked_range<int>(0, light.rows), [&](const tbb::blocked_range<int>& rows) {
    for (int y = rows.begin(); y < rows.end(); ++y) {
      const float* in = light.ptr<float>(y);
      std::uint8_t* out = image.ptr<std::uint8_t>(y);
      for (int x = 0; x < light.cols; ++x) {
        const float mean = in[x] * to_electrons;
        const float noise = Normal(Hash(noise_key, static_cast<std::uint64_t>(y) << 32 | static_cast<unsigned>(x)));
        const float electrons = std::min(mean + std::sqrt(mean + read_variance) * noise, full_well);
        out[x] = static_cast<std::uint8_t>(std::clamp(electrons * to_grey + 0.5f, 0.0f, 255.0f));
      }
    }
  });
  return image;
}

}  // namespace granary
