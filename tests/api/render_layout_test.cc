// SPDX-License-Identifier: Apache-2.0
// The layout of the renderer's public structs, as layout_test.cc has it for the codec's.
#include <gtest/gtest.h>

#include <cstddef>
#include <type_traits>

#include "l4d/experimental/sensitivity.h"
#include "l4d/render.h"

namespace {

template <typename T>
constexpr bool plain() {
  return std::is_standard_layout_v<T> && std::is_trivially_copyable_v<T>;
}

#if defined(__LP64__) || defined(_WIN64)
#define L4D_LAYOUT(type, bytes) \
  static_assert(plain<type>() && sizeof(type) == (bytes), #type " changed its size")
#define L4D_FIELD(type, field, offset) \
  static_assert(offsetof(type, field) == (offset), #type "." #field " moved")
L4D_LAYOUT(l4d_renderer_options, 40);
L4D_FIELD(l4d_renderer_options, max_memory_bytes, 24);
L4D_FIELD(l4d_renderer_options, backend, 12);
L4D_FIELD(l4d_renderer_options, cancel, 32);
L4D_FIELD(l4d_renderer_options, device, 20);
L4D_FIELD(l4d_renderer_options, threads, 8);
L4D_FIELD(l4d_renderer_options, exponential, 16);
L4D_LAYOUT(l4d_camera, 152);
L4D_FIELD(l4d_camera, width, 8);
L4D_FIELD(l4d_camera, fx, 16);
L4D_FIELD(l4d_camera, world_to_camera, 48);
L4D_FIELD(l4d_camera, near_plane, 144);
L4D_LAYOUT(l4d_image, 24);
L4D_LAYOUT(l4d_gradients, 72);
L4D_FIELD(l4d_gradients, position, 16);
L4D_LAYOUT(l4d_sensitivity_options, 24);
L4D_FIELD(l4d_sensitivity_options, seed, 16);
L4D_LAYOUT(l4d_view, 16);
L4D_FIELD(l4d_view, camera, 8);
L4D_LAYOUT(l4d_process_group, 32);
L4D_FIELD(l4d_process_group, sum, 16);
L4D_LAYOUT(l4d_measure_options, 72);
L4D_FIELD(l4d_measure_options, progress, 56);
L4D_FIELD(l4d_measure_options, group, 48);
L4D_FIELD(l4d_measure_options, agreement, 24);
L4D_LAYOUT(l4d_measure_report, 80);
L4D_FIELD(l4d_measure_report, agreement, 40);
L4D_FIELD(l4d_measure_report, unseen, 72);
L4D_LAYOUT(l4d_render_stats, 96);
L4D_FIELD(l4d_render_stats, seconds, 32);
#endif

TEST(RenderLayout, ConstantsKeepTheirValues) {
  EXPECT_EQ(L4D_RENDER_EXP_ACCURATE, 0);
  EXPECT_EQ(L4D_RENDER_EXP_FAST, 1);
  EXPECT_EQ(L4D_SENSITIVITY_SUM, 0);
  EXPECT_EQ(L4D_SENSITIVITY_GAUSS_NEWTON, 1);
  EXPECT_EQ(L4D_RENDER_PASS_SLICE, 0);
  EXPECT_EQ(L4D_RENDER_PASS_BACKWARD, 5);
  EXPECT_EQ(L4D_RENDER_PASS_COUNT, 6);
}

TEST(RenderLayout, StructSizeComesFirst) {
  EXPECT_EQ(offsetof(l4d_renderer_options, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_camera, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_image, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_gradients, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_sensitivity_options, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_measure_options, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_measure_report, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_render_stats, struct_size), 0u);
}

}  // namespace
