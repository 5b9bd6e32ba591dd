// Scale space of CGAL, a yardstick only: four steps of twelve neighbours, then its two meshers; CPU seconds of one thread.
//
//     g++ -O3 -DNDEBUG -DCGAL_EIGEN3_ENABLED -I EIGEN benchmarks/cgal_scale_space.cpp -o cgal_scale_space -lmpfr -lgmp
//     cgal_scale_space POINTS        three little-endian doubles a point
//
// Prints: points, seconds of the smoothing, of the advancing front, of the alpha shape, and the triangles of both.

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Scale_space_reconstruction_3/Advancing_front_mesher.h>
#include <CGAL/Scale_space_reconstruction_3/Alpha_shape_mesher.h>
#include <CGAL/Scale_space_reconstruction_3/Weighted_PCA_smoother.h>
#include <CGAL/Scale_space_surface_reconstruction_3.h>

#include <cstdio>
#include <ctime>
#include <fstream>
#include <vector>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Reconstruction = CGAL::Scale_space_surface_reconstruction_3<Kernel>;
namespace parts = CGAL::Scale_space_reconstruction_3;

static double seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

int main(int, char** argv) {
    std::vector<Kernel::Point_3> points;
    std::ifstream file(argv[1], std::ios::binary);
    double xyz[3];
    while (file.read(reinterpret_cast<char*>(xyz), sizeof xyz)) points.emplace_back(xyz[0], xyz[1], xyz[2]);

    double begin = seconds();
    Reconstruction front(points.begin(), points.end());
    parts::Weighted_PCA_smoother<Kernel> smoother(12, 300);
    front.increase_scale(4, smoother);
    const double smoothing = seconds() - begin;
    Reconstruction alpha = front;

    begin = seconds();
    parts::Advancing_front_mesher<Kernel> front_mesher(0.0);
    front.reconstruct_surface(front_mesher);
    const double fronting = seconds() - begin;

    begin = seconds();
    parts::Alpha_shape_mesher<Kernel> alpha_mesher(smoother.squared_radius());
    alpha.reconstruct_surface(alpha_mesher);
    std::printf("%zu %.3f %.3f %.3f %zu %zu\n", points.size(), smoothing, fronting, seconds() - begin, front.number_of_facets(),
                alpha.number_of_facets());
}
