// Rigid transforms, named target_from_source.
#pragma once

#include <Eigen/Geometry>

namespace granary {

/// Metres. The world frame is right-handed, z up, z = 0 on the bin's floor.
using RigidTransform = Eigen::Isometry3d;

}  // namespace granary
