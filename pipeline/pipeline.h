// The measuring pipeline: frames in, one measurement and every intermediate out.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/options.h"
#include "pipeline/reference.h"
#include "pipeline/surface.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/calibration.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/measurement.h"
#include "pipeline/types/transform.h"

namespace granary {

/// One rig as the pipeline needs it.
struct RigSetup {
  std::string name;
  StereoCalibration calibration;
  RigidTransform world_from_left = RigidTransform::Identity();
  std::optional<Reference> reference;  ///< the empty bin, seen by this rig
};

/// What one rig contributed to a run. Mats are in the rectified left frame, H×W; empty when the run ended before.
struct RigView {
  cv::Mat left, right;      ///< rectified grey, CV_32FC1
  cv::Mat disparity_px;     ///< CV_32FC1, +inf invalid
  cv::Mat deviation_px;     ///< CV_32FC1, standard deviation of the disparity, NaN invalid
  cv::Mat points_in_world;  ///< CV_32FC3, metres, NaN invalid
  cv::Mat grain_mask;       ///< CV_8UC1, 255 where the point is grain
};

struct PipelineRun {
  Measurement measurement;  ///< valid, or with the reason why not
  std::vector<RigView> rigs;
  Surface surface;            ///< empty when the run ended before
  double relief_area_m2 = 0;  ///< floor area over which a surface offset of the grain counts, see relief.h
};

/// Milliseconds on a steady clock, for the stage timings; the pipeline itself reads no clock.
using Stopwatch = std::function<double()>;

/// Immutable after construction; Run may be called from several threads at once.
class Pipeline {
 public:
  /// @throws std::invalid_argument when a calibration, pose or reference cannot be used, naming the rig and why.
  Pipeline(Bin bin, std::vector<RigSetup> rigs, PipelineOptions options);
  ~Pipeline();
  Pipeline(Pipeline&&) noexcept;

  /// Measures once. A poor picture is a verdict (`measurement.reason`), not an exception.
  /// @param shots one or more, each one pair for each rig in the order of the rigs; several are fused, their own
  /// volumes
  ///   give `repeatability_rsd_percent`, and what moved between them is a verdict
  /// @param stopwatch when given, `measurement.timings_ms` is filled, but for `capture`
  [[nodiscard]] PipelineRun RunShots(const std::vector<Shot>& shots, const Inventory& inventory,
                                     const Stopwatch& stopwatch = {}) const;
  /// RunShots with a single one.
  [[nodiscard]] PipelineRun Run(const Shot& pairs, const Inventory& inventory, const Stopwatch& stopwatch = {}) const {
    return RunShots({pairs}, inventory, stopwatch);
  }

  /// The cloud of the empty bin as rig `rig` sees it. A verdict other than kOk means that `reference` is not set.
  struct ReferenceRun {
    Reason reason = Reason::kOk;
    std::string detail;
    std::optional<Reference> reference;
    RigView view;
    double coverage_percent = 0;  ///< of the floor
  };
  [[nodiscard]] ReferenceRun TakeReference(std::size_t rig, const FramePair& pair) const;

  /// Things an engineer should know about the set-up, e.g. that the top of the bin is too near to be measured.
  [[nodiscard]] const std::vector<std::string>& Notes() const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace granary
