#include "pipeline/reference.h"

#include <cstdint>
#include <cstdio>

namespace granary {

namespace {

class Fnv1a {
 public:
  void Add(const void* bytes, std::size_t size) {
    const auto* at = static_cast<const unsigned char*>(bytes);
    for (std::size_t i = 0; i < size; ++i) hash_ = (hash_ ^ at[i]) * 0x100000001b3ULL;
  }
  void Add(double value) {
    value += 0.0;  // −0 and 0 are one number
    Add(&value, sizeof value);
  }
  [[nodiscard]] std::string Hex() const {
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash_));
    return text;
  }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325ULL;
};

}  // namespace

std::string HashOfRig(const StereoCalibration& calibration, const RigidTransform& world_from_left) {
  Fnv1a hash;
  hash.Add(calibration.image_size.width);
  hash.Add(calibration.image_size.height);
  for (const auto* K : {&calibration.K1, &calibration.K2, &calibration.R}) {
    for (int i = 0; i < 9; ++i) hash.Add(K->val[i]);
  }
  for (const auto* D : {&calibration.D1, &calibration.D2}) {
    for (const double coefficient : *D) hash.Add(coefficient);
  }
  for (int i = 0; i < 3; ++i) hash.Add(calibration.T_m[i]);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) hash.Add(world_from_left.matrix()(r, c));
  }
  return hash.Hex();
}

std::string HashOfPoints(const cv::Mat& points_in_world) {
  Fnv1a hash;
  for (int y = 0; y < points_in_world.rows; ++y) {
    hash.Add(points_in_world.ptr(y), static_cast<std::size_t>(points_in_world.cols) * points_in_world.elemSize());
  }
  return hash.Hex();
}

}  // namespace granary
