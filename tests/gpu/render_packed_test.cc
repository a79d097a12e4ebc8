// SPDX-License-Identifier: Apache-2.0
// Rendering from SH codebooks and indices, against the same Gaussians with their SH expanded.
#include <cuda_runtime_api.h>

#include <memory>

#include "l4d/experimental/cuda_packed.h"
#include "l4d/experimental/cuda_render.h"
#include "tests/common/codec.h"
#include "tests/gpu/decode_support.h"
#include "tests/gpu/render_support.h"

namespace l4d::render {
namespace {

using test::cuda_check;
using test::PoisonedMemory;

// A stream of codebooks: `stages` of SH, and every so many-th Gaussian an escape; 0 = none.
Bytes encode_indexed(const io::Scene& scene, size_t stages, size_t escape_each) {
  test::TestScene source;
  source.timeline = scene.timeline;
  source.sh_degree = scene.sh_degree;
  source.flags = scene.flags;
  source.position = scene.position;
  source.mean_t = scene.mean_t;
  source.log_scale = scene.log_scale;
  source.rotor = scene.rotor;
  source.opacity = scene.opacity;
  source.sh = scene.sh;
  source.window = scene.window;
  test::EncodeOptions o;
  o.preset = "indexed";
  o.rans = true;
  o.settings = {{L4D_ENC_PROFILE, L4D_PROFILE_INDEXED},
                {L4D_ENC_CODEBOOK_SIZE, 64},
                {L4D_ENC_KMEANS_ITERATIONS, 2},
                {L4D_ENC_PAGE_SIZE, 700},
                {L4D_ENC_MERGE_COUNT, 40},
                {L4D_ENC_MAX_BASE_COLOR_ERROR, 1e6},  // so that weights alone make escapes
                {L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 1e6}};
  const std::vector<double> fractions = {1, 0.6, 0.4, 0.2};
  o.stages = {{L4D_ENC_STAGES ".sh",
               {fractions.begin(), fractions.begin() + static_cast<std::ptrdiff_t>(stages)}}};
  std::vector<float> weights(scene.count(), 1.0f);
  for (size_t i = 0; escape_each > 0 && i < weights.size(); i += escape_each) weights[i] = 40.0f;
  if (escape_each > 0) {
    o.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD, 37.5});
    o.weights.emplace_back(L4D_WEIGHT_SH, &weights);
  }
  return test::encode(source, o).bytes;
}

// A stream on the device, its SH in both forms.
class DecodedScene {
 public:
  explicit DecodedScene(const Bytes& file) : file_(file) {
    decoder_.open_memory(file_.data(), file_.size());
    device_ = std::make_unique<test::DeviceDecoding>(decoder_);
    l4d_cuda_decoder* d = device_->get();
    l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
    request.forms = L4D_CUDA_FORM_EXPANDED | L4D_CUDA_FORM_PACKED;
    const l4d_query query = test::all_query();
    check(l4d_cuda_decoder_prepare(d, &query, &request));
    n_ = static_cast<size_t>(request.num_gaussians);
    const l4d_info info = decoder_.info();
    terms_ = (info.sh_degree + 1) * (info.sh_degree + 1);
    for (uint32_t s = 0; s < L4D_MAX_STAGES; ++s) {
      l4d_codebook codebook = L4D_INIT(l4d_codebook);
      check(l4d_cuda_decoder_get_codebook(d, 0, L4D_COMPONENT_SH, s, L4D_NO_BLOCK, &codebook));
      if (codebook.entries != nullptr) codebooks.push_back(codebook);
    }
    const PoisonedMemory workspace(static_cast<size_t>(request.workspace_bytes));
    const auto array = [&](size_t bytes) {
      arrays_.push_back(std::make_unique<PoisonedMemory>(std::max<size_t>(bytes, 1)));
      return arrays_.back().get();
    };
    l4d_cuda_gaussian_buffers expanded = L4D_INIT(l4d_cuda_gaussian_buffers);
    expanded.capacity = n_;
    expanded.position = array(12 * n_)->floats();
    expanded.mean_t = array(4 * n_)->floats();
    expanded.log_scale = array(16 * n_)->floats();
    expanded.rotor = array(32 * n_)->floats();
    expanded.opacity = array(4 * n_)->floats();
    expanded.sh = array(12 * terms_ * n_)->floats();
    if ((info.tools & L4D_TOOL_FLAT_WINDOWS) != 0) expanded.window = array(8 * n_)->words();
    check(
        l4d_cuda_decoder_decode(d, &expanded, workspace.data(), request.workspace_bytes, nullptr));
    check(l4d_cuda_decoder_finish(d));
    l4d_cuda_packed_buffers packed = L4D_INIT(l4d_cuda_packed_buffers);
    packed.capacity = n_ + 5;
    l4d_cuda_packed_component& sh = packed.component[L4D_COMPONENT_SH];
    sh.depth = static_cast<uint8_t*>(array(n_)->data());
    sh.index = static_cast<uint16_t*>(array(2 * codebooks.size() * packed.capacity)->data());
    sh.escape = static_cast<uint16_t*>(array(6 * terms_ * n_)->data());
    sh.escape_capacity = n_;
    check(l4d_cuda_decoder_decode_packed(d, &packed, workspace.data(), request.workspace_bytes,
                                         nullptr));
    check(l4d_cuda_decoder_finish(d));
    uint64_t escapes[L4D_COMPONENT_COUNT];
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      check(l4d_cuda_decoder_get_num_escapes(d, c, &escapes[c]));
    }
    gaussians = L4D_INIT(l4d_gaussians);
    gaussians.count = n_;
    gaussians.sh_degree = info.sh_degree;
    gaussians.flags = info.flags;
    gaussians.position = expanded.position;
    gaussians.mean_t = expanded.mean_t;
    gaussians.log_scale = expanded.log_scale;
    gaussians.rotor = expanded.rotor;
    gaussians.opacity = expanded.opacity;
    gaussians.sh = expanded.sh;
    gaussians.window = expanded.window;
    timeline = info.timeline;
    indices = L4D_INIT(l4d_cuda_sh_indices);
    indices.depth = sh.depth;
    indices.index = sh.index;
    indices.stride = packed.capacity;
    indices.escape = sh.escape;
    indices.num_escapes = escapes[L4D_COMPONENT_SH];
  }
  size_t count() const { return n_; }
  // Without SH.
  l4d_gaussians geometry() const {
    l4d_gaussians g = gaussians;
    g.sh = nullptr;
    return g;
  }

  l4d_gaussians gaussians{};
  l4d_timeline timeline{};
  l4d_cuda_sh_indices indices{};
  std::vector<l4d_codebook> codebooks;

 private:
  void check(l4d_status status) const { ASSERT_EQ(status, L4D_OK) << l4d_last_error_message(); }

  Bytes file_;
  DecoderHandle decoder_;
  std::unique_ptr<test::DeviceDecoding> device_;
  std::vector<std::unique_ptr<PoisonedMemory>> arrays_;
  size_t n_ = 0, terms_ = 0;
};

class Renderer {
 public:
  explicit Renderer(uint32_t sh_format = L4D_CUDA_SH_FLOAT32) {
    l4d_cuda_renderer_options options = L4D_INIT(l4d_cuda_renderer_options);
    options.sh_format = sh_format;
    EXPECT_EQ(l4d_cuda_renderer_create(&options, &r_), L4D_OK);
  }
  ~Renderer() { l4d_cuda_renderer_destroy(r_); }
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;
  l4d_cuda_renderer* get() const { return r_; }
  void check(l4d_status status) const { EXPECT_EQ(status, L4D_OK) << l4d_last_error_message(); }
  void reserve(const l4d_camera& camera, uint64_t visible) const {
    l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
    capacity.width = camera.width;
    capacity.height = camera.height;
    capacity.visible = visible;
    capacity.instances = 1 << 20;
    check(l4d_cuda_renderer_reserve(r_, &capacity));
  }
  std::vector<float> render(const l4d_camera& camera, double time) const {
    const PoisonedMemory rgb(size_t{12} * camera.width * camera.height);
    l4d_cuda_image image = L4D_INIT(l4d_cuda_image);
    image.rgb = rgb.floats();
    check(l4d_cuda_renderer_render(r_, time, &camera, &image, nullptr));
    l4d_cuda_frame_stats stats = L4D_INIT(l4d_cuda_frame_stats);
    check(l4d_cuda_renderer_get_stats(r_, nullptr, &stats));
    EXPECT_GT(stats.projected, 50u);
    return rgb.read();
  }

 private:
  l4d_cuda_renderer* r_ = nullptr;
};

void set_whole(const Renderer& r, const DecodedScene& scene) {
  r.check(l4d_cuda_renderer_set_sh_codebooks(r.get(), scene.codebooks.data(),
                                             static_cast<uint32_t>(scene.codebooks.size())));
  const l4d_gaussians g = scene.geometry();
  r.check(l4d_cuda_renderer_set_gaussians(r.get(), &g, &scene.indices, &scene.timeline));
}

TEST(IndexedRender, ImagesAreThoseOfExpandedSh) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    for (const size_t stages : {1u, 2u, 3u, 4u}) {
      for (const size_t escape_each : {size_t{0}, size_t{9}}) {
        SCOPED_TRACE(testing::Message() << "degree " << degree << ", " << stages
                                        << " stages, an escape in " << escape_each);
        const DecodedScene scene(
            encode_indexed(with_degree(synth(4000, 3 + degree), degree), stages, escape_each));
        ASSERT_EQ(scene.codebooks.size(), stages);
        EXPECT_EQ(scene.indices.num_escapes > 0, escape_each > 0);
        for (const uint32_t format : {L4D_CUDA_SH_FLOAT32, L4D_CUDA_SH_FLOAT16}) {
          const Renderer expanded(format), indexed(format);
          expanded.check(l4d_cuda_renderer_set_gaussians(expanded.get(), &scene.gaussians, nullptr,
                                                         &scene.timeline));
          set_whole(indexed, scene);
          for (const double time : {0.4, 2.6}) {
            const l4d_camera camera = ring_camera(160, 110, 0.7 + time);
            expanded.reserve(camera, scene.count());
            indexed.reserve(camera, scene.count());
            const std::vector<float> image = indexed.render(camera, time);
            const std::vector<float> e = expanded.render(camera, time);
            if (format == L4D_CUDA_SH_FLOAT32) {
              EXPECT_TRUE(equal_bits(image, e)) << largest_difference(image, e);
            } else {
              EXPECT_LT(largest_difference(image, e), 1e-3);
            }
          }
        }
      }
    }
  }
}

TEST(IndexedRender, FlatWindows) {
  L4D_SKIP_WITHOUT_DEVICE();
  const DecodedScene scene(encode_indexed(with_windows(synth(8000, 3)), 2, 9));
  ASSERT_NE(scene.gaussians.window, nullptr);
  const Renderer expanded, indexed;
  expanded.check(
      l4d_cuda_renderer_set_gaussians(expanded.get(), &scene.gaussians, nullptr, &scene.timeline));
  set_whole(indexed, scene);
  const l4d_camera camera = ring_camera(160, 110, 1.3);
  expanded.reserve(camera, scene.count());
  indexed.reserve(camera, scene.count());
  std::vector<float> before;
  for (const double frame : {36.0, 36.5, 37.0}) {
    const std::vector<float> image = indexed.render(camera, frame / 30);
    EXPECT_TRUE(equal_bits(image, expanded.render(camera, frame / 30))) << frame;
    EXPECT_FALSE(equal_bits(image, before)) << frame;
    before = image;
  }
}

TEST(IndexedRender, CodebooksGoAndCome) {
  L4D_SKIP_WITHOUT_DEVICE();
  const DecodedScene one(encode_indexed(with_degree(synth(3000, 5), 1), 1, 0));
  const DecodedScene other(encode_indexed(synth(3000, 6), 3, 5));
  const l4d_camera camera = ring_camera(160, 110, 1.0);
  const Renderer r, expected;
  for (const DecodedScene* scene : {&one, &other, &one}) {
    set_whole(r, *scene);
    r.reserve(camera, scene->count());
    expected.check(l4d_cuda_renderer_set_gaussians(expected.get(), &scene->gaussians, nullptr,
                                                   &scene->timeline));
    expected.reserve(camera, scene->count());
    EXPECT_TRUE(equal_bits(r.render(camera, 1.0), expected.render(camera, 1.0)));
  }
  // A scene with SH of its own beside codebooks, and rows after they are gone.
  r.check(l4d_cuda_renderer_set_gaussians(r.get(), &other.gaussians, nullptr, &other.timeline));
  expected.check(
      l4d_cuda_renderer_set_gaussians(expected.get(), &other.gaussians, nullptr, &other.timeline));
  EXPECT_TRUE(equal_bits(r.render(camera, 1.0), expected.render(camera, 1.0)));
  r.check(l4d_cuda_renderer_set_sh_codebooks(r.get(), nullptr, 0));
  const l4d_gaussians g = one.geometry();
  EXPECT_EQ(l4d_cuda_renderer_set_gaussians(r.get(), &g, &one.indices, &one.timeline),
            L4D_ERR_INVALID_STATE);
}

TEST(IndexedRender, RefusesWhatDoesNotFit) {
  L4D_SKIP_WITHOUT_DEVICE();
  const DecodedScene scene(encode_indexed(synth(3000, 6), 2, 5));
  const Renderer r;
  std::vector<l4d_codebook> codebooks = scene.codebooks;
  const auto set_codebooks = [&] {
    return l4d_cuda_renderer_set_sh_codebooks(r.get(), codebooks.data(),
                                              static_cast<uint32_t>(codebooks.size()));
  };
  codebooks[1].dim = 12;
  EXPECT_EQ(set_codebooks(), L4D_ERR_INVALID_ARGUMENT);
  codebooks[1].dim = 47;
  EXPECT_EQ(set_codebooks(), L4D_ERR_INVALID_ARGUMENT);
  codebooks[1] = scene.codebooks[1];
  codebooks[0].entries = nullptr;
  EXPECT_EQ(set_codebooks(), L4D_ERR_INVALID_ARGUMENT);
  codebooks.assign(L4D_MAX_STAGES + 1, scene.codebooks[0]);
  EXPECT_EQ(set_codebooks(), L4D_ERR_INVALID_ARGUMENT);
  codebooks = scene.codebooks;
  ASSERT_EQ(set_codebooks(), L4D_OK);
  const auto set_scene = [&](const l4d_gaussians& g, const l4d_cuda_sh_indices& indices) {
    return l4d_cuda_renderer_set_gaussians(r.get(), &g, &indices, &scene.timeline);
  };
  l4d_gaussians g = scene.geometry();
  EXPECT_EQ(set_scene(scene.gaussians, scene.indices), L4D_ERR_INVALID_ARGUMENT);
  g.sh_degree = 2;
  EXPECT_EQ(set_scene(g, scene.indices), L4D_ERR_INVALID_ARGUMENT);
  g.sh_degree = 3;
  l4d_cuda_sh_indices indices = scene.indices;
  indices.stride = scene.count() - 1;
  EXPECT_EQ(set_scene(g, indices), L4D_ERR_INVALID_ARGUMENT);
  indices = scene.indices;
  indices.index = nullptr;
  EXPECT_EQ(set_scene(g, indices), L4D_ERR_INVALID_ARGUMENT);
  indices = scene.indices;
  indices.escape = nullptr;
  EXPECT_EQ(set_scene(g, indices), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(set_scene(g, scene.indices), L4D_OK);
}

// Indices that no codebook has: nothing outside is read, and what is inside looks as it did.
TEST(IndexedRender, BringsBackWhatIsBeyondTheCodebooks) {
  L4D_SKIP_WITHOUT_DEVICE();
  const DecodedScene scene(encode_indexed(synth(3000, 6), 2, 5));
  const size_t n = scene.count();
  const l4d_camera camera = ring_camera(160, 110, 1.0);
  const PoisonedMemory index(4 * n), depth(n);
  // All indices are 0xb5b5, and depths 0xb5 with an escape here and there.
  std::vector<uint8_t> depths(n, 0xb5);
  for (size_t i = 0; i < n; i += 3) depths[i] = 255;
  cuda_check(cudaMemcpy(depth.data(), depths.data(), n, cudaMemcpyHostToDevice));
  l4d_cuda_sh_indices indices = scene.indices;
  indices.index = static_cast<const uint16_t*>(index.data());
  indices.stride = n;
  indices.depth = static_cast<const uint8_t*>(depth.data());
  const Renderer r, last;
  const l4d_gaussians g = scene.geometry();
  for (const Renderer* renderer : {&r, &last}) {
    renderer->check(l4d_cuda_renderer_set_sh_codebooks(
        renderer->get(), scene.codebooks.data(), static_cast<uint32_t>(scene.codebooks.size())));
    renderer->reserve(camera, n);
  }
  r.check(l4d_cuda_renderer_set_gaussians(r.get(), &g, &indices, &scene.timeline));
  // What it comes to: the last codewords, and no SH where there are fewer escapes than said.
  std::vector<uint16_t> wanted(2 * n);
  size_t escapes = 0;
  for (size_t i = 0; i < n; ++i) {
    if (depths[i] == 255) {
      if (escapes++ >= indices.num_escapes) depths[i] = 0;
    } else {
      depths[i] = 2;
    }
    for (size_t s = 0; s < 2; ++s) {
      wanted[s * n + i] = static_cast<uint16_t>(scene.codebooks[s].num_entries - 1);
    }
  }
  ASSERT_GT(escapes, indices.num_escapes);
  cuda_check(cudaMemcpy(depth.data(), depths.data(), n, cudaMemcpyHostToDevice));
  cuda_check(cudaMemcpy(index.data(), wanted.data(), 4 * n, cudaMemcpyHostToDevice));
  last.check(l4d_cuda_renderer_set_gaussians(last.get(), &g, &indices, &scene.timeline));
  EXPECT_TRUE(equal_bits(r.render(camera, 1.0), last.render(camera, 1.0)));
}

}  // namespace
}  // namespace l4d::render
