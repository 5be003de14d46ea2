// Whether a picture is good enough to be measured.
#pragma once

#include <string>

#include <opencv2/core/mat.hpp>

#include "pipeline/options.h"
#include "pipeline/rectify.h"
#include "pipeline/types/reason.h"

namespace granary {

struct PictureQuality {
  double mean_fraction = 0;       ///< mean grey inside the mask, share of full scale
  double speckle_contrast = 0;    ///< RMS of the dots over the mean, median over small squares
  double saturated_fraction = 0;  ///< share of saturated neighbourhoods inside the mask
};

/// One rectified picture. @param grey CV_32FC1, 0 … 255  @param mask CV_8UC1, what of it counts
[[nodiscard]] PictureQuality AssessPicture(const cv::Mat& grey, const cv::Mat& mask);

/// Of the two pictures the worse in each respect.
/// @param left_mask, right_mask CV_8UC1, where the bin is in each rectified picture
[[nodiscard]] PictureQuality AssessPictures(const RectifiedPair& pair, const cv::Mat& left_mask,
                                            const cv::Mat& right_mask);

struct Verdict {
  Reason reason = Reason::kOk;
  std::string detail;  ///< the figure and the limit, for a person
};

/// The first gate that the pictures fail, in the order dark, saturated, projector dark, low contrast.
[[nodiscard]] Verdict JudgePictures(const PictureQuality& quality, const QualityOptions& options);

}  // namespace granary
