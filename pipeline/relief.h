// Grain relief: a matcher sees the tops of kernels more than the gaps between them.
#pragma once

#include "pipeline/surface.h"
#include "pipeline/types/bin.h"

namespace granary {

/// How much of the relief a surface `height_m` above the floor shows, 0 … 1: all of it from a kernel's height on, none
/// on bare floor.
[[nodiscard]] double ReliefShare(double height_m);

/// Floor area over which the relief counts: the integral of ReliefShare over the triangles, m². One metre of offset
/// changes the volume by this area.
[[nodiscard]] double ReliefArea_m2(const Surface& surface);

/// Lowers the surface by `offset_m` times ReliefShare, vertex by vertex: heights and z alike.
void TakeReliefOff(double offset_m, Surface& surface);

/// Standard deviation of the offset, m.
/// @param simulated frames of the simulator, whose grain is smooth: without an offset there is no relief to be unsure
/// of
[[nodiscard]] double ReliefDeviation_m(const GrainKind& grain, bool simulated);

}  // namespace granary
