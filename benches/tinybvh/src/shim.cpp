// tinybvh's eight-wide tree for the CPU behind a few C functions.
#define TINYBVH_IMPLEMENTATION
#include "tiny_bvh.h"

#include <chrono>

#ifndef BVH_USEAVX2
#error "tinybvh's BVH8_CPU needs AVX2 and FMA"
#endif

using namespace tinybvh;

namespace {

// A ray is origin, direction, t_min (which tinybvh does not have: it starts
// at zero) and t_max. Its constructor makes the direction a unit vector.
inline Ray make(const float* r, float length)
{
    const float far = r[7] * length;
    return Ray(bvhvec3(r[0], r[1], r[2]), bvhvec3(r[3], r[4], r[5]), far < BVH_FAR ? far : BVH_FAR);
}

inline float length_of(const float* r)
{
    return sqrtf(r[3] * r[3] + r[4] * r[4] + r[5] * r[5]);
}

}

extern "C" {

void raytwin_tinybvh_version(uint32_t* out)
{
    out[0] = TINY_BVH_VERSION_MAJOR, out[1] = TINY_BVH_VERSION_MINOR, out[2] = TINY_BVH_VERSION_SUB;
}

// Vertices have four floats each; they and the indices must outlive the tree.
void* raytwin_tinybvh_build(const float* vertices, uint32_t count, const uint32_t* indices,
    uint32_t triangles, bool high, double* milliseconds)
{
    const auto start = std::chrono::steady_clock::now();
    BVH8_CPU* tree = new BVH8_CPU();
    const bvhvec4slice slice((const bvhvec4*)vertices, count, sizeof(bvhvec4));
    if (high) tree->BuildHQ(slice, indices, triangles);
    else tree->Build(slice, indices, triangles);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    *milliseconds = time.count();
    return tree;
}

void raytwin_tinybvh_free(void* tree)
{
    delete (BVH8_CPU*)tree;
}

bool raytwin_tinybvh_closest(const void* tree, const float* r, float* t, uint32_t* primitive)
{
    const float length = length_of(r);
    Ray ray = make(r, length);
    const float far = ray.hit.t;
    ((const BVH8_CPU*)tree)->Intersect(ray);
    *t = ray.hit.t / length, *primitive = ray.hit.prim;
    return ray.hit.t < far;
}

bool raytwin_tinybvh_occluded(const void* tree, const float* r)
{
    const Ray ray = make(r, length_of(r));
    return ((const BVH8_CPU*)tree)->IsOccluded(ray);
}

}
