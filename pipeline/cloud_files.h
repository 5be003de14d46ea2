// Disparity maps, clouds and meshes for other people's programs. All writers replace the file whole or not at all.
#pragma once

#include <filesystem>
#include <span>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "pipeline/colours.h"
#include "pipeline/surface.h"

namespace granary {

/// Portable float map as Middlebury has it: one channel, little endian, rows bottom-up, invalid = +inf.
/// @param values H×W, CV_32FC1
/// @throws FileError
void WritePfm(const std::filesystem::path& file, const cv::Mat& values);
/// @return H×W, CV_32FC1, rows top-down; either byte order is read.
/// @throws FileError when it is no one-channel PFM or its size is not what its header says
[[nodiscard]] cv::Mat ReadPfm(const std::filesystem::path& file);

/// The surface's vertices as binary PLY: float x y z nx ny nz (metres, world frame), uchar red green blue
/// (kMeasuredColour or kCompletedColour), uchar interpolated (1 completed, 0 measured). A normal is the area-weighted
/// mean of the triangles around; a vertex of no triangle points up.
/// @throws FileError
void WritePlyCloud(const std::filesystem::path& file, const Surface& surface);
/// WritePlyCloud and the faces. @throws FileError
void WritePlyMesh(const std::filesystem::path& file, const Surface& surface);

/// Any points as binary PLY: float x y z (metres, world frame), uchar red green blue.
/// @param colours one a point
/// @throws FileError
void WritePlyPoints(const std::filesystem::path& file, std::span<const Eigen::Vector3f> points_in_world,
                    std::span<const Rgb> colours);

/// An organised cloud: one point a pixel.
struct PcdCloud {
  cv::Mat points;   ///< H×W, CV_32FC3, metres, NaN invalid
  cv::Mat noise_m;  ///< H×W, CV_32FC1, NaN invalid; empty when the file has none
};

/// Binary PCD v0.7, WIDTH × HEIGHT points in the order of the pixels, fields x y z and, when `noise_m` is not empty,
/// noise.
/// @param points H×W, CV_32FC3  @param noise_m H×W, CV_32FC1, or empty
/// @throws FileError
void WritePcd(const std::filesystem::path& file, const cv::Mat& points, const cv::Mat& noise_m = {});
/// Reads what WritePcd writes, bit for bit. @throws FileError for any other layout, a truncated or an oversized file.
[[nodiscard]] PcdCloud ReadPcd(const std::filesystem::path& file);

}  // namespace granary
