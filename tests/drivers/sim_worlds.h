// Worlds for tests of the simulator, small enough to render in milliseconds.
#pragma once

#include "drivers/options.h"
#include "drivers/rig.h"

namespace granary {

/// The paper's box under two 640×512 cameras 1.1 m up, 0.11 m apart, toed in, tilted and distorted.
inline RigWorld SmallLabWorld() {
  RigWorld world;
  world.bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
  world.bin.height_m = 0.285;
  StereoCalibration& c = world.calibration;
  c.image_size = {640, 512};
  c.K1 = {750, 0, 322, 0, 752, 254, 0, 0, 1};
  c.K2 = {748, 0, 317, 0, 747, 259, 0, 0, 1};
  c.D1 = {-0.11, 0.09, 0.0004, -0.0003, 0};
  c.D2 = {-0.10, 0.08, -0.0003, 0.0004, 0};
  const auto turn = [](const Eigen::Vector3d& axis, double angle) {
    return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  };
  const Eigen::Matrix3d r = turn(Eigen::Vector3d::UnitY(), 0.021) * turn(Eigen::Vector3d::UnitZ(), -0.006);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) c.R(i, j) = r(i, j);
  }
  c.T_m = {-0.1098, -0.0006, 0.002};
  Eigen::Matrix3d looking_down;
  looking_down << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  world.world_from_left.linear() =
      looking_down * turn(Eigen::Vector3d::UnitX(), 0.02) * turn(Eigen::Vector3d::UnitZ(), 0.025);
  world.world_from_left.translation() = Eigen::Vector3d(0.21, 0.165, 1.1);
  return world;
}

/// A bay 12 × 8 × 10.4 m with two pillars at its walls and the cameras inside it, 9 m up.
inline RigWorld SmallWarehouseWorld() {
  RigWorld world = SmallLabWorld();
  world.bin.footprint_m = {{0, 0}, {12, 0}, {12, 8}, {0, 8}};
  world.bin.height_m = 10.4;
  world.bin.exclude_m = {{{2.3, 0}, {2.7, 0}, {2.7, 0.3}, {2.3, 0.3}}, {{9.6, 7.7}, {10, 7.7}, {10, 8}, {9.6, 8}}};
  StereoCalibration& c = world.calibration;
  c.K1 = {194, 0, 321, 0, 194, 254, 0, 0, 1};
  c.K2 = {195, 0, 318, 0, 195, 257, 0, 0, 1};
  c.D1 = {-0.021, 0.0012, 0.0002, -0.0002, 0};
  c.D2 = {-0.020, 0.0011, -0.0001, 0.0002, 0};
  c.T_m = {-0.8, -0.009, 0.013};
  world.world_from_left.translation() = Eigen::Vector3d(5.6, 4.05, 9.02);
  return world;
}

/// Options for SmallWarehouseWorld.
inline SimOptions WarehouseOptions() {
  SimOptions options;
  options.volume_m3 = 400;
  return options;
}

}  // namespace granary
