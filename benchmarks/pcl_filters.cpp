// PCL's filters on a file of float64 x y z rows: processor seconds of VoxelGrid at two edges, and of both outlier filters on the first tenth of the rows.
// g++ -O3 pcl_filters.cpp -o pcl_filters -I.../pcl-1.13 -I.../eigen3 -lpcl_filters -lpcl_search -lpcl_kdtree -lpcl_common -lflann_cpp
#include <pcl/filters/radius_outlier_removal.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_types.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

template <class Filter>
void timed(const char* what, Filter& filter, const Cloud::Ptr& cloud) {
  Cloud out;
  const std::clock_t start = std::clock();
  filter.setInputCloud(cloud);
  filter.filter(out);
  std::printf("%s of %zu, PCL: %.2f cpu s, %zu left\n", what, cloud->size(), double(std::clock() - start) / CLOCKS_PER_SEC, out.size());
  std::fflush(stdout);
}

int main(int argc, char** argv) {
  if (argc != 3) return std::fprintf(stderr, "pcl_filters POINTS RADIUS\n"), 2;
  std::ifstream in(argv[1], std::ios::binary);
  Cloud::Ptr cloud(new Cloud), few(new Cloud);
  for (double row[3]; in.read(reinterpret_cast<char*>(row), sizeof row);) cloud->emplace_back(row[0], row[1], row[2]);
  for (std::size_t k = 0; k < cloud->size() / 10; ++k) few->push_back((*cloud)[k]);
  for (const float edge : {0.1f, 0.02f}) {
    pcl::VoxelGrid<pcl::PointXYZ> grid;
    grid.setLeafSize(edge, edge, edge);
    timed(edge > 0.05f ? "voxel mean, edge 0.1 m," : "voxel mean, edge 0.02 m,", grid, cloud);
  }
  pcl::RadiusOutlierRemoval<pcl::PointXYZ> radius;
  radius.setRadiusSearch(std::atof(argv[2]));
  radius.setMinNeighborsInRadius(15);
  timed("radius filter", radius, few);
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> statistical;
  statistical.setMeanK(15);
  timed("statistical filter", statistical, few);
}
