// The chain as it can be put together from libraries.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <vector>

#include <pcl/filters/passthrough.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/segment_differences.h>
#include <Eigen/Core>
#ifdef GRANARY_HAVE_VTK
#include <vtkCellArray.h>
#include <vtkDelaunay2D.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#endif

#include "pipeline/delaunay.h"
#include "tests/bench/box_scene.h"
#include "tests/bench/chain_case.h"

namespace granary {

#ifndef GRANARY_HAVE_VTK

ChainFigures RunStockChain() { throw std::runtime_error("built without VTK (libvtk9-dev): no stock triangulation"); }

#else

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
constexpr float kDistance_m = 0.004F;
constexpr double kEdge_m = 8 * BoxScene::kCamera / BoxScene::kFocal_px;  // ours at this spacing of points

Cloud::Ptr AsCloud(const std::vector<Eigen::Vector3f>& points) {
  auto cloud = std::make_shared<Cloud>();
  for (const auto& p : points) cloud->push_back({p.x(), p.y(), p.z()});
  return cloud;
}

Cloud::Ptr Pass(const Cloud::Ptr& cloud, const char* axis, double low, double high) {
  pcl::PassThrough<pcl::PointXYZ> filter;
  filter.setInputCloud(cloud);
  filter.setFilterFieldName(axis);
  filter.setFilterLimits(static_cast<float>(low), static_cast<float>(high));
  auto passed = std::make_shared<Cloud>();
  filter.filter(*passed);
  return passed;
}

double SumPrisms_m3(vtkPolyData& mesh, std::size_t& triangles) {
  double volume_m3 = 0;
  vtkNew<vtkIdList> corners;
  vtkCellArray& cells = *mesh.GetPolys();
  for (cells.InitTraversal(); cells.GetNextCell(corners) != 0;) {
    std::array<std::array<double, 3>, 3> p{};
    for (int k = 0; k < 3; ++k) mesh.GetPoint(corners->GetId(k), p[static_cast<std::size_t>(k)].data());
    double longest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto &a = p[k], &b = p[(k + 1) % 3];
      longest = std::max(longest, std::hypot(b[0] - a[0], b[1] - a[1]));
    }
    if (longest > kEdge_m) continue;
    const double twice_area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    volume_m3 += std::abs(twice_area) / 2 * (p[0][2] + p[1][2] + p[2][2]) / 3;
    ++triangles;
  }
  return volume_m3;
}

}  // namespace

ChainFigures RunStockChain() {
  const Cloud::Ptr full = AsCloud(SeeBox(true, 1)), empty = AsCloud(SeeBox(false, 2));
  ChainFigures out;
  ResetPeak();
  out.before_mib = Status_mib("VmRSS");
  const Times start = Now();
  Times last = start;
  const auto lap = [&](const char* name) {
    const Times now = Now();
    out.steps.push_back({name, now - last});
    last = now;
  };

  pcl::SegmentDifferences<pcl::PointXYZ> difference;
  difference.setInputCloud(full);
  difference.setTargetCloud(empty);
  difference.setDistanceThreshold(kDistance_m * kDistance_m);  // PCL compares squared distances with it
  auto grain = std::make_shared<Cloud>();
  difference.segment(*grain);
  lap("pcl::SegmentDifferences");

  grain = Pass(Pass(Pass(grain, "x", 0, BoxScene::kLength), "y", 0, BoxScene::kBreadth), "z", 0, BoxScene::kTop);
  lap("pcl::PassThrough");

  vtkNew<vtkPoints> points;
  for (const auto& p : *grain) points->InsertNextPoint(p.x, p.y, p.z);
  vtkNew<vtkPolyData> cloud;
  cloud->SetPoints(points);
  vtkNew<vtkDelaunay2D> delaunay;
  delaunay->SetInputData(cloud);
  delaunay->Update();
  lap("vtkDelaunay2D");

  out.volume_m3 = SumPrisms_m3(*delaunay->GetOutput(), out.triangles);
  lap("prisms");
  out.total = last - start;
  out.peak_mib = Status_mib("VmHWM");

  std::vector<Eigen::Vector2d> plan;
  for (const auto& p : *grain) plan.emplace_back(p.x, p.y);
  last = Now();
  static_cast<void>(TriangulateDelaunay(plan));
  out.apart.push_back({"our TriangulateDelaunay on the same points", Now() - last});
  return out;
}

#endif

}  // namespace granary
