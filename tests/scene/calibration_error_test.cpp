// Pictures by the true cameras, measured with calibrations of simulated boards, as a depot would have them. The bench
// uncertainty_coverage does the same with many more.
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/pipeline/simulated_boards.h"
#include "tests/scene/simulated_bin.h"

namespace granary {
namespace {

TEST(CalibrationError, TheTruthLiesWithinTheStatedUncertainty) {
  const RigWorld world = SimulatedLab();
  RigWorld empty = world;
  empty.empty_bin = true;
  const FramePair empty_bin = SimScene({}, empty).Render(0);
  // The shapes on which errors of calibration weigh most.
  for (const SimShape shape : {SimShape::kTiltedLeft, SimShape::kPartial}) {
    SimOptions options;
    options.shape = shape;
    SimScene scene(options, world);
    const FramePair grain = scene.Render(1);
    for (const std::uint64_t seed : {1, 2, 3}) {
      const BoardViews boards = Noisy(SimulatedBoards(world.calibration, 16, seed), 0.1, seed + 50);
      RigSetup rig{"a", CalibrateBoards(boards, world.calibration), {}, {}};
      rig.world_from_left = FoundPose(world.bin, world.calibration, world.world_from_left, rig.calibration);
      for (const bool stored : {true, false}) {
        if (!stored) rig.calibration.covariance = cv::Mat();
        rig.reference.reset();
        rig.reference = Pipeline(world.bin, {rig}, {}).TakeReference(0, empty_bin).reference;
        ASSERT_TRUE(rig.reference);
        const Measurement m = Pipeline(world.bin, {rig}, {}).Run({grain}, {}).measurement;
        ASSERT_TRUE(m.valid) << m.detail;
        std::printf("shape %d, calibration %d, %s: %+.3f %%, u95 %.3f %%\n", static_cast<int>(shape),
                    static_cast<int>(seed), stored ? "covariance stored" : "by default",
                    100 * (*m.volume_m3 / scene.TruthVolume_m3() - 1), 100 * *m.volume_u95_m3 / *m.volume_m3);
        EXPECT_NEAR(*m.volume_m3, scene.TruthVolume_m3(), *m.volume_u95_m3);
        EXPECT_LT(*m.volume_u95_m3, 0.005 * *m.volume_m3);
      }
    }
  }
}

}  // namespace
}  // namespace granary
