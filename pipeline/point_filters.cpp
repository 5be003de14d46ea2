// The steps of segment.h that PCL does. It gets finite points only: its filters and searches crash or lie on others
// when a cloud calls itself dense.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <stdexcept>

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/console/print.h>
#include <pcl/filters/passthrough.h>
#include <pcl/filters/radius_outlier_removal.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Eigenvalues>

#include "pipeline/segment.h"

namespace granary {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
constexpr double kMaxFloorTilt = 10 * std::numbers::pi / 180;

/// The finite points of `points` as a dense cloud, and their indices.
struct FiniteCloud {
  Cloud::Ptr cloud = std::make_shared<Cloud>();
  std::vector<std::size_t> index;
};

FiniteCloud TakeFinite(std::span<const Eigen::Vector3f> points, std::size_t stride = 1) {
  FiniteCloud result;
  result.cloud->reserve(points.size() / stride + 1);
  result.index.reserve(points.size() / stride + 1);
  for (std::size_t i = 0; i < points.size(); i += stride) {
    if (!points[i].allFinite()) continue;
    result.cloud->push_back(pcl::PointXYZ(points[i].x(), points[i].y(), points[i].z()));
    result.index.push_back(i);
  }
  result.cloud->is_dense = true;
  return result;
}

std::vector<std::uint8_t> PassThrough(std::span<const Eigen::Vector3f> points, const char* field, float low,
                                      float high) {
  if (!(low <= high)) throw std::invalid_argument("PassThrough: the lower limit exceeds the upper one, or is NaN");
  std::vector<std::uint8_t> inside(points.size(), 0);
  // Chunk by chunk, so that PCL's copy of the points stays in the cache.
  constexpr std::size_t kChunk = 32'768;
  tbb::parallel_for(std::size_t{0}, (points.size() + kChunk - 1) / kChunk, [&](std::size_t chunk) {
    const std::size_t begin = chunk * kChunk;
    const FiniteCloud finite = TakeFinite(points.subspan(begin, std::min(kChunk, points.size() - begin)));
    pcl::PassThrough<pcl::PointXYZ> filter;
    filter.setInputCloud(finite.cloud);
    filter.setFilterFieldName(field);
    filter.setFilterLimits(low, high);
    pcl::Indices kept;
    filter.filter(kept);
    for (const auto i : kept) inside[begin + finite.index[static_cast<std::size_t>(i)]] = 1;
  });
  return inside;
}

/// Plane through the centroid of the finite points within the tolerance of `plane`, normal the direction of least
/// spread.
std::optional<FloorPlane> Refine(std::span<const Eigen::Vector3f> points, const Eigen::Vector4d& plane,
                                 double tolerance_m) {
  const auto supports = [&](const Eigen::Vector3d& p) {
    return std::abs(plane.head<3>().dot(p) + plane(3)) <= tolerance_m;  // false for NaN
  };
  std::size_t finite = 0, support = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& point : points) {
    const Eigen::Vector3d p = point.cast<double>();
    if (!p.allFinite()) continue;
    ++finite;
    if (!supports(p)) continue;
    ++support;
    sum += p;
  }
  if (support < 3) return std::nullopt;
  const Eigen::Vector3d centre = sum / static_cast<double>(support);
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const auto& point : points) {
    const Eigen::Vector3d p = point.cast<double>();
    if (p.allFinite() && supports(p)) spread += (p - centre) * (p - centre).transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread);
  // Points on one line spread in one direction only and leave the plane open.
  if (!(solver.eigenvalues()(1) > 1e-12 * solver.eigenvalues()(2))) return std::nullopt;
  Eigen::Vector3d normal = solver.eigenvectors().col(0);
  if (normal.z() < 0) normal = -normal;
  if (normal.z() < std::cos(kMaxFloorTilt)) return std::nullopt;
  FloorPlane result;
  result.coefficients << normal, -normal.dot(centre);
  result.inlier_share = static_cast<double>(support) / static_cast<double>(finite);
  return result;
}

}  // namespace

std::vector<std::uint8_t> PassThroughX(std::span<const Eigen::Vector3f> points, float min_x_m, float max_x_m) {
  return PassThrough(points, "x", min_x_m, max_x_m);
}
std::vector<std::uint8_t> PassThroughY(std::span<const Eigen::Vector3f> points, float min_y_m, float max_y_m) {
  return PassThrough(points, "y", min_y_m, max_y_m);
}
std::vector<std::uint8_t> PassThroughZ(std::span<const Eigen::Vector3f> points, float min_z_m, float max_z_m) {
  return PassThrough(points, "z", min_z_m, max_z_m);
}

std::vector<std::uint8_t> FindOutliers(std::span<const Eigen::Vector3f> points, double radius_m, int min_neighbours) {
  if (!(radius_m > 0) || !std::isfinite(radius_m)) {
    throw std::invalid_argument("FindOutliers: the radius must be finite and above 0 m");
  }
  if (min_neighbours < 1) throw std::invalid_argument("FindOutliers: at least 1 neighbour must be asked for");
  std::vector<std::uint8_t> outlier(points.size(), 1);
  const FiniteCloud finite = TakeFinite(points);
  if (finite.cloud->empty()) return outlier;
  pcl::RadiusOutlierRemoval<pcl::PointXYZ> filter;
  filter.setInputCloud(finite.cloud);
  filter.setRadiusSearch(radius_m);
  filter.setMinNeighborsInRadius(min_neighbours);
  pcl::Indices kept;
  filter.filter(kept);
  for (const auto i : kept) outlier[finite.index[static_cast<std::size_t>(i)]] = 0;
  return outlier;
}

std::optional<FloorPlane> FitFloorPlane(std::span<const Eigen::Vector3f> points, double tolerance_m) {
  if (!(tolerance_m > 0) || !std::isfinite(tolerance_m)) {
    throw std::invalid_argument("FitFloorPlane: the tolerance must be finite and above 0 m");
  }
  // PCL reports on stderr what is returned here as "no plane".
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  constexpr std::size_t kSample = 20'000;  // a plane that 5 % of the points support has 1,000 there
  const FiniteCloud sample = TakeFinite(points, points.size() / kSample + 1);
  if (sample.cloud->size() < 3) return std::nullopt;
  pcl::SACSegmentation<pcl::PointXYZ> ransac(false);  // false: the same random numbers every time
  ransac.setInputCloud(sample.cloud);
  ransac.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  ransac.setMethodType(pcl::SAC_RANSAC);
  ransac.setAxis(Eigen::Vector3f::UnitZ());
  ransac.setEpsAngle(kMaxFloorTilt);
  ransac.setDistanceThreshold(tolerance_m);
  ransac.setMaxIterations(1000);
  ransac.setProbability(0.999);
  pcl::ModelCoefficients model;
  pcl::PointIndices support;
  ransac.segment(support, model);
  if (model.values.size() != 4 || support.indices.size() < 3) return std::nullopt;
  const Eigen::Vector4d plane = Eigen::Map<const Eigen::Vector4f>(model.values.data()).cast<double>();
  const auto first = Refine(points, plane, tolerance_m);
  if (!first) return std::nullopt;
  return Refine(points, first->coefficients, tolerance_m);  // again: the better plane has better supporters
}

}  // namespace granary
