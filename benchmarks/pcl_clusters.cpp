// PCL's Euclidean clustering of a file of float64 x y z rows: clusters of the given radius and least size, labels to a file, processor seconds.
// g++ -O3 -march=native pcl_clusters.cpp -o pcl_clusters -I.../pcl-1.13 -I.../eigen3 -lpcl_segmentation -lpcl_search -lpcl_kdtree -lpcl_common -lflann_cpp
#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <vector>

int main(int argc, char** argv) {
  if (argc != 5) return std::fprintf(stderr, "pcl_clusters POINTS RADIUS LEAST LABELS\n"), 2;
  std::ifstream in(argv[1], std::ios::binary);
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  for (double row[3]; in.read(reinterpret_cast<char*>(row), sizeof row);) cloud->emplace_back(row[0], row[1], row[2]);
  const std::clock_t start = std::clock();
  pcl::search::KdTree<pcl::PointXYZ>::Ptr tree(new pcl::search::KdTree<pcl::PointXYZ>);
  tree->setInputCloud(cloud);
  std::vector<pcl::PointIndices> clusters;
  pcl::EuclideanClusterExtraction<pcl::PointXYZ> extraction;
  extraction.setClusterTolerance(std::atof(argv[2]));
  extraction.setMinClusterSize(std::atoi(argv[3]));
  extraction.setMaxClusterSize(cloud->size());
  extraction.setSearchMethod(tree);
  extraction.setInputCloud(cloud);
  extraction.extract(clusters);
  std::printf("%.4f\n", double(std::clock() - start) / CLOCKS_PER_SEC);
  std::vector<std::int64_t> label(cloud->size(), -1);
  for (std::size_t k = 0; k < clusters.size(); ++k)
    for (const auto row : clusters[k].indices) label[row] = k;
  std::ofstream(argv[4], std::ios::binary).write(reinterpret_cast<const char*>(label.data()), label.size() * sizeof(std::int64_t));
}
