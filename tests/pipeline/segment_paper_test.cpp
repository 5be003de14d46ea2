// Zhao 2023, Figures 12 and 13: clustering by distance within one cloud cannot part grain from the walls it touches;
// distance to the cloud of the empty bin can.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include "pipeline/segment.h"

namespace granary {
namespace {

constexpr float kLength_m = 0.52F, kWidth_m = 0.355F, kHeight_m = 0.285F, kStep_m = 0.004F;

struct Scene {
  std::vector<Eigen::Vector3f> points;
  std::vector<std::uint8_t> is_grain;
};

/// The paper's box seen from above, and where `level` says so a heap in it: a sheet that hides floor and lower walls.
Scene BoxWithHeap(bool filled, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 0.0003F);
  const auto level = [](float x, float y) { return 0.10F + 0.05F * std::sin(6 * x) * std::cos(5 * y); };
  Scene scene;
  const auto add = [&](float x, float y, float z, bool grain) {
    scene.points.emplace_back(x + noise(random), y + noise(random), z + noise(random));
    scene.is_grain.push_back(grain ? 1 : 0);
  };
  for (float x = 0; x <= kLength_m; x += kStep_m) {
    for (float y = 0; y <= kWidth_m; y += kStep_m) add(x, y, filled ? level(x, y) : 0, filled);
  }
  for (float z = kStep_m; z <= kHeight_m; z += kStep_m) {
    const auto wall = [&](float x, float y) {
      if (!filled || z > level(x, y)) add(x, y, z, false);
    };
    for (float x = 0; x <= kLength_m; x += kStep_m) {
      wall(x, 0);
      wall(x, kWidth_m);
    }
    for (float y = 0; y <= kWidth_m; y += kStep_m) {
      wall(0, y);
      wall(kLength_m, y);
    }
  }
  return scene;
}

TEST(EuclideanClustering, OfPclTakesAHeapAndTheWallsItTouchesForOneCluster) {
  const Scene full = BoxWithHeap(true, 1);
  const auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  for (const auto& p : full.points) cloud->push_back({p.x(), p.y(), p.z()});
  const auto tree = std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>();
  tree->setInputCloud(cloud);
  pcl::EuclideanClusterExtraction<pcl::PointXYZ> clustering;
  clustering.setInputCloud(cloud);
  clustering.setSearchMethod(tree);
  clustering.setClusterTolerance(2 * kStep_m);
  clustering.setMinClusterSize(100);
  std::vector<pcl::PointIndices> clusters;
  clustering.extract(clusters);
  ASSERT_EQ(clusters.size(), 1U);
  std::size_t grain = 0;
  for (const auto i : clusters[0].indices) grain += full.is_grain[static_cast<std::size_t>(i)];
  EXPECT_GT(grain, 1000U);
  EXPECT_GT(clusters[0].indices.size() - grain, 1000U);
}

TEST(FindScenePoints, LeavesOnlyGrainOfTheHeapThatClusteringCannotPart) {
  const Scene full = BoxWithHeap(true, 1), empty = BoxWithHeap(false, 2);
  // The two clouds of one wall lie a step of 4 mm and noise of 0.3 mm apart: 1.5 steps find every wall point.
  const double distance_m = 1.5 * kStep_m;
  const auto scene = FindScenePoints(full.points, empty.points, distance_m);
  std::size_t kept_grain = 0, kept_scene = 0, inner_grain = 0;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    kept_grain += full.is_grain[i] && !scene[i];
    kept_scene += !full.is_grain[i] && !scene[i];
    const auto& p = full.points[i];
    const float to_wall = std::min({p.x(), p.y(), kLength_m - p.x(), kWidth_m - p.y()});
    inner_grain += full.is_grain[i] && to_wall > distance_m + 5 * 0.0003;
  }
  EXPECT_EQ(kept_scene, 0U);
  EXPECT_GE(kept_grain, inner_grain);  // all but the strip along the walls
}

}  // namespace
}  // namespace granary
