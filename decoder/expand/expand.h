// SPDX-License-Identifier: Apache-2.0
// The columns of one page to float attributes (spec: "Reconstruction").
#pragma once

#include <array>
#include <vector>

#include "decoder/expand/reconstruct.h"
#include "decoder/expand/transform.h"
#include "l4d/decode.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/quant/codebook.h"

namespace l4d {

// The loops of one backend.
struct ExpandKernels {
  const ReconstructKernels* reconstruct = nullptr;
  const TransformKernels* transform = nullptr;
};

// Codebooks a page needs, resolved before pages are worked on in parallel; of a transform its
// basis.
struct PageCodebooks {
  std::array<std::array<const CodebookData*, L4D_MAX_STAGES>, L4D_COMPONENT_COUNT> codebook{};
};

// Buffers kept from page to page.
struct ExpandScratch {
  std::vector<float> rows_a, rows_b, factor, means, sh;
};

class PageExpander {
 public:
  // Where `columns` lack SH detail, so does what comes out.
  PageExpander(const SceneHeader& header, const LayerHeader& layer, const PageColumns& columns,
               const PageCodebooks& codebooks, const ExpandKernels& kernels, ExpandScratch& scratch)
      : header_(header),
        layer_(layer),
        columns_(columns),
        codebooks_(codebooks),
        kernels_(*kernels.reconstruct),
        transform_(*kernels.transform),
        scratch_(scratch) {}

  // Fills the arrays of `out` that are given, from Gaussian `first` on.
  void run(const l4d_bucket_span& span, size_t first, const l4d_gaussian_buffers& out);

 private:
  void positions(float* dst) const;
  void means(const l4d_bucket_span& span, size_t first, const l4d_gaussian_buffers& out);
  void windows(const l4d_bucket_span& span, size_t first, const l4d_gaussian_buffers& out) const;
  void scalars(const ScalarCoding& coding, const std::vector<uint16_t>& codes,
               const std::vector<float>& raw, float* dst) const;
  void opacities(float* dst) const;
  void spherical_harmonics(size_t first, const l4d_gaussian_buffers& out);
  void log_scales(float* dst);
  void rotors(float* dst);
  void stereographic_rotors(float* dst);

  const SceneHeader& header_;
  const LayerHeader& layer_;
  const PageColumns& columns_;
  const PageCodebooks& codebooks_;
  const ReconstructKernels& kernels_;
  const TransformKernels& transform_;
  ExpandScratch& scratch_;
  bool past_cache_ = false;
};

}  // namespace l4d
