// SPDX-License-Identifier: Apache-2.0
#include "tests/decoder/packed.h"

#include <cmath>

#include "l4d/experimental/packed.h"
#include "libl4dcodec/base/half.h"

namespace l4d::test {
namespace {

l4d_layer_info layer_info(const DecoderHandle& d, uint32_t layer) {
  l4d_layer_info i = L4D_INIT(l4d_layer_info);
  d.check(l4d_decoder_get_layer_info(d.get(), layer, &i));
  return i;
}

unsigned component_dim(const l4d_info& info, const l4d_layer_info& layer, unsigned c) {
  if (c == L4D_COMPONENT_SH) return 3 * (info.sh_degree + 1) * (info.sh_degree + 1);
  return c == L4D_COMPONENT_SCALE && layer.permanent != 0 ? 3 : 4;
}

// Spec: each half is divided by its length; (1, 0, 0, 0) where that vanishes.
void normalize(float* q) {
  const float norm2 = (q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]);
  if (norm2 < 1e-12f) {
    q[0] = 1;
    q[1] = q[2] = q[3] = 0;
    return;
  }
  const float r = std::sqrt(norm2);
  for (int k = 0; k < 4; ++k) q[k] = q[k] / r;
}

void merge_rotor(const float* s, const float* t, float* out) {
  float a[4] = {s[0] + t[3], s[1] - t[2], s[2] + t[1], s[3] - t[0]};
  float b[4] = {s[0] - t[3], s[1] + t[2], s[2] - t[1], s[3] + t[0]};
  normalize(a);
  normalize(b);
  for (int k = 0; k < 4; ++k) out[k] = (a[k] + b[k]) * 0.5f;
  out[4] = (b[3] - a[3]) * 0.5f;
  out[5] = (a[2] - b[2]) * 0.5f;
  out[6] = (b[1] - a[1]) * 0.5f;
  out[7] = (a[0] - b[0]) * 0.5f;
}

class Expander {
 public:
  Expander(const DecoderHandle& d, const PackedArrays& p) : d_(d), p_(p), info_(d.info()) {}

  GaussianArrays run() {
    const size_t n = p_.count();
    const size_t sh_dim = component_dim(info_, l4d_layer_info{}, L4D_COMPONENT_SH);
    out_.sh_degree = info_.sh_degree;
    out_.flags = info_.flags;
    out_.position.resize(3 * n);
    out_.mean_t.resize(n);
    out_.mean_t_local.resize(n);
    out_.log_scale.resize(4 * n);
    out_.rotor.resize(8 * n);
    out_.opacity.resize(n);
    out_.sh.resize(sh_dim * n);
    out_.spans = p_.spans;
    for (const l4d_bucket_span& r : p_.spans) expand_range(r, sh_dim);
    return out_;
  }

 private:
  void expand_range(const l4d_bucket_span& r, size_t sh_dim) {
    const l4d_layer_info layer = layer_info(d_, r.layer);
    l4d_dequantization q = L4D_INIT(l4d_dequantization);
    d_.check(l4d_decoder_get_dequantization(d_.get(), r.layer, &q));
    const size_t end = static_cast<size_t>(r.first + r.count);
    for (size_t i = static_cast<size_t>(r.first); i < end; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        out_.position[3 * i + k] =
            q.position_center[k] + q.position_scale * half_to_float(p_.position[3 * i + k]);
      }
      out_.mean_t_local[i] = static_cast<float>(r.width) * half_to_float(p_.mean_t[i]);
      out_.mean_t[i] = static_cast<float>(r.center + static_cast<double>(out_.mean_t_local[i]));
      out_.opacity[i] = q.opacity_offset + q.opacity_step * static_cast<float>(p_.opacity[i]);
      const float factor =
          q.scale_factor_offset + q.scale_factor_step * static_cast<float>(p_.scale_factor[i]);
      row(r, layer, L4D_COMPONENT_SH, i, out_.sh.data() + sh_dim * i);
      float scale[4] = {0, 0, 0, 0};
      row(r, layer, L4D_COMPONENT_SCALE, i, scale);
      for (size_t k = 0; k < 4; ++k) out_.log_scale[4 * i + k] = factor + scale[k];
      if (layer.permanent != 0) out_.log_scale[4 * i + 3] = 0;
      float spatial[4], temporal[4];
      row(r, layer, L4D_COMPONENT_ROTOR_SPATIAL, i, spatial);
      row(r, layer, L4D_COMPONENT_ROTOR_TEMPORAL, i, temporal);
      merge_rotor(spatial, temporal, out_.rotor.data() + 8 * i);
    }
  }

  void row(const l4d_bucket_span& r, const l4d_layer_info& layer, unsigned c, size_t i,
           float* dst) {
    const unsigned dim = component_dim(info_, layer, c);
    for (unsigned k = 0; k < dim; ++k) dst[k] = 0;
    const uint8_t depth = p_.depth[c][i];
    if (depth == 255) {
      for (unsigned k = 0; k < dim; ++k) {
        dst[k] = half_to_float(p_.escape[c][escapes_[c]++]);
      }
      return;
    }
    for (uint32_t s = 0; s < depth; ++s) {
      l4d_codebook codebook = L4D_INIT(l4d_codebook);
      d_.check(l4d_decoder_get_codebook(d_.get(), r.layer, c, s, s == 0 ? r.block : L4D_NO_BLOCK,
                                        &codebook));
      const float* entry = codebook.entries + size_t{dim} * p_.index[c][s * p_.count() + i];
      for (unsigned k = 0; k < dim; ++k) dst[k] = s == 0 ? entry[k] : dst[k] + entry[k];
    }
  }

  const DecoderHandle& d_;
  const PackedArrays& p_;
  l4d_info info_;
  std::array<size_t, L4D_COMPONENT_COUNT> escapes_{};
  GaussianArrays out_;
};

}  // namespace

PackedArrays decode_packed(const DecoderHandle& decoder, const l4d_query& query) {
  const l4d_selection s = decoder.select(query);
  const size_t n = static_cast<size_t>(s.num_gaussians);
  PackedArrays p;
  p.position.resize(3 * n);
  p.mean_t.resize(n);
  p.opacity.resize(n);
  p.scale_factor.resize(n);
  p.spans.resize(static_cast<size_t>(s.num_spans));
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  b.capacity = n;
  b.position = p.position.data();
  b.mean_t = p.mean_t.data();
  b.opacity = p.opacity.data();
  b.scale_factor = p.scale_factor.data();
  b.spans = p.spans.data();
  b.span_capacity = p.spans.size();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    p.depth[c].resize(n);
    p.index[c].assign(L4D_MAX_STAGES * n, 0xeeee);
    p.escape[c].resize(48 * n);
    b.component[c].depth = p.depth[c].data();
    b.component[c].index = p.index[c].data();
    b.component[c].escape = p.escape[c].data();
    b.component[c].escape_capacity = n;
  }
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &b));
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) p.num_escapes[c] = b.component[c].num_escapes;
  return p;
}

GaussianArrays expand(const DecoderHandle& decoder, const PackedArrays& packed) {
  return Expander(decoder, packed).run();
}

}  // namespace l4d::test
