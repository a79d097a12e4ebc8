// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace l4d {

// What a search may assume about coordinates. It decides the speed alone.
enum class Axes {
  kAny,
  kPrincipal  // uncorrelated and in order of falling energy: nothing is gained by rotating them
};

// A device that may do searches. They are the host's to the last bit, so that files do not depend
// on it.
class NearestDevice {
 public:
  virtual ~NearestDevice() = default;
  // Points that stay there from one search to the next. One search at a time; gone before its
  // device is.
  class HeldPoints {
   public:
    virtual ~HeldPoints() = default;
  };
  struct Job {
    const float* points;  // [n, dim]
    size_t n, dim;
    const float* codebook;  // [k, dim]
    size_t k;
    uint32_t first_label;        // of codeword 0
    bool keep;                   // codewords have to beat labels and sq_dist as given
    uint32_t* labels;            // [n]
    float* sq_dist;              // [n]
    HeldPoints* held = nullptr;  // where hold() took these points
  };
  // False where it leaves the work to the host: too little of it, no kernel, busy, or a failure.
  virtual bool search(const Job& job) = 0;
  // For searches of about k codewords each. Null where it leaves them to the host.
  virtual std::unique_ptr<HeldPoints> hold(const float* points, size_t n, size_t dim, size_t k) = 0;
};

// Who searches: threads of the host, 0 = one per core, and a device where there is one.
struct NearestBackend {
  NearestBackend(int threads_, NearestDevice* device_ = nullptr,
                 NearestDevice::HeldPoints* held_ = nullptr)
      : threads(threads_), device(device_), held(held_) {}
  int threads;
  NearestDevice* device;
  NearestDevice::HeldPoints* held;  // the points of the search, null where it has to bring them
};

// For each point the nearest codeword in squared Euclidean distance.
//   points   [n, dim]   row-major
//   codebook [k, dim]   row-major, k >= 1
//   hint     [n] or nullptr: likely labels, such as those of the previous iteration. They make the
//            search faster and never change its result; values >= k are ignored.
//   labels   [n]        index of the nearest codeword, the lowest one on ties
//   sq_dist  [n]        its squared distance
// The search is exact: its result is what a scan of all codewords in the same float arithmetic
// gives, for any number of threads. A point with a coordinate that is not a number gets label 0 and
// distance infinity, as does one whose every distance overflows.
void assign_nearest(const float* points, size_t n, size_t dim, const float* codebook, size_t k,
                    const NearestBackend& backend, const uint32_t* hint, uint32_t* labels,
                    float* sq_dist, Axes axes = Axes::kAny);

// The same by its definition, one pair at a time in double precision: what the tests compare with.
void assign_nearest_reference(const float* points, size_t n, size_t dim, const float* codebook,
                              size_t k, int threads, const uint32_t* hint, uint32_t* labels,
                              float* sq_dist);

// Takes codewords that join a codebook into account: where one of them is strictly nearer than
// sq_dist[i], labels[i] becomes first_label + its index in `codebook` and sq_dist[i] its distance.
// Meant for a few codewords at a time: it takes the axes as they are.
void update_nearest(const float* points, size_t n, size_t dim, const float* codebook, size_t k,
                    uint32_t first_label, const NearestBackend& backend, uint32_t* labels,
                    float* sq_dist);

}  // namespace l4d
