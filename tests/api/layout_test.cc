// SPDX-License-Identifier: Apache-2.0
// The layout of public structs is part of the binary interface: later versions append fields, and a
// change of what is here breaks programs that are already compiled.
#include <gtest/gtest.h>

#include <cstddef>
#include <type_traits>

#include "l4d/decode.h"
#include "l4d/encode.h"
#include "l4d/experimental/columns.h"
#include "l4d/experimental/copy.h"
#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "l4d/experimental/session.h"
#include "l4d/members.h"
#include "l4d/playback.h"

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
L4D_LAYOUT(l4d_reader, 48);
L4D_LAYOUT(l4d_writer, 24);
L4D_LAYOUT(l4d_timeline, 24);
L4D_LAYOUT(l4d_gaussians, 88);
L4D_FIELD(l4d_gaussians, window, 80);
L4D_FIELD(l4d_gaussians, mean_t_double, 72);
L4D_LAYOUT(l4d_placement, 40);
L4D_LAYOUT(l4d_decoder_options, 72);
L4D_FIELD(l4d_decoder_options, threads, 28);
L4D_FIELD(l4d_decoder_options, cache_bytes, 40);
L4D_FIELD(l4d_decoder_options, tolerant, 48);
L4D_FIELD(l4d_decoder_options, accept_needs, 52);
L4D_FIELD(l4d_decoder_options, progress, 56);
L4D_LAYOUT(l4d_info, 144);
L4D_FIELD(l4d_info, streamable, 136);
L4D_FIELD(l4d_info, num_gaussians, 40);
L4D_FIELD(l4d_info, timeline, 56);
L4D_FIELD(l4d_info, placement, 88);
L4D_FIELD(l4d_info, profile, 128);
L4D_LAYOUT(l4d_coding_errors, 136);
L4D_FIELD(l4d_coding_errors, position, 16);
L4D_FIELD(l4d_coding_errors, min_size, 88);
L4D_FIELD(l4d_coding_errors, colors_stated, 96);
L4D_FIELD(l4d_coding_errors, base_color, 104);
L4D_FIELD(l4d_coding_errors, directional_color_bound, 128);
L4D_LAYOUT(l4d_layer_info, 128);
L4D_FIELD(l4d_layer_info, tier, 120);
L4D_FIELD(l4d_layer_info, symbols_per_gaussian, 124);
L4D_FIELD(l4d_layer_info, num_stages, 56);
L4D_FIELD(l4d_layer_info, coding, 88);
L4D_LAYOUT(l4d_operating_point, 16);
L4D_LAYOUT(l4d_query, 72);
L4D_FIELD(l4d_query, time_begin, 16);
L4D_FIELD(l4d_query, point, 32);
L4D_FIELD(l4d_query, whole_buckets, 48);
L4D_FIELD(l4d_query, buckets, 56);
L4D_LAYOUT(l4d_shown_stream, 16);
L4D_LAYOUT(l4d_read, 24);
L4D_LAYOUT(l4d_member, 88);
L4D_FIELD(l4d_member, begin, 32);
L4D_FIELD(l4d_member, number, 56);
L4D_FIELD(l4d_member, sequence_begin, 72);
L4D_LAYOUT(l4d_members_options, 24);
L4D_LAYOUT(l4d_members_info, 48);
L4D_FIELD(l4d_members_info, rest_message, 40);
L4D_FIELD(l4d_members_info, rest, 36);
L4D_LAYOUT(l4d_session_options, 48);
L4D_FIELD(l4d_session_options, standing_segments, 32);
L4D_FIELD(l4d_session_options, max_memory_bytes, 40);
L4D_LAYOUT(l4d_member_parameters, 80);
L4D_FIELD(l4d_member_parameters, shift, 32);
L4D_FIELD(l4d_member_parameters, edit_end, 64);
L4D_FIELD(l4d_member_parameters, tiers, 76);
L4D_LAYOUT(l4d_time_span, 16);
L4D_LAYOUT(l4d_playback_options, 168);
L4D_FIELD(l4d_playback_options, unit_grain, 32);
L4D_FIELD(l4d_playback_options, ahead, 64);
L4D_FIELD(l4d_playback_options, max_step, 120);
L4D_FIELD(l4d_playback_options, stale_after, 160);
L4D_LAYOUT(l4d_quality, 32);
L4D_LAYOUT(l4d_playback_item, 88);
L4D_FIELD(l4d_playback_item, units, 48);
L4D_FIELD(l4d_playback_item, value, 80);
L4D_LAYOUT(l4d_answer, 48);
L4D_LAYOUT(l4d_playback_state, 216);
L4D_FIELD(l4d_playback_state, live_delay, 192);
L4D_LAYOUT(l4d_shown_member, 32);
L4D_LAYOUT(l4d_playback_loss, 32);
L4D_LAYOUT(l4d_bucket_span, 48);
L4D_FIELD(l4d_bucket_span, layer, 32);
L4D_LAYOUT(l4d_selection, 56);
L4D_FIELD(l4d_selection, sh_bytes, 48);
L4D_LAYOUT(l4d_gaussian_buffers, 136);
L4D_FIELD(l4d_gaussian_buffers, sh_half, 128);
L4D_FIELD(l4d_gaussian_buffers, window, 120);
L4D_FIELD(l4d_gaussian_buffers, id, 112);
L4D_FIELD(l4d_gaussian_buffers, mean_t_double, 104);
L4D_FIELD(l4d_gaussian_buffers, spans, 80);
L4D_LAYOUT(l4d_packed_component, 40);
L4D_LAYOUT(l4d_packed_buffers, 248);
L4D_FIELD(l4d_packed_buffers, window, 240);
L4D_FIELD(l4d_packed_buffers, component, 56);
L4D_FIELD(l4d_packed_buffers, spans, 216);
L4D_LAYOUT(l4d_codebook, 24);
L4D_LAYOUT(l4d_gaussian_id, 16);
L4D_FIELD(l4d_gaussian_id, index, 8);
L4D_LAYOUT(l4d_splat_buffers, 152);
L4D_FIELD(l4d_splat_buffers, point, 136);
L4D_FIELD(l4d_splat_buffers, scale, 80);
L4D_FIELD(l4d_splat_buffers, id, 104);
L4D_FIELD(l4d_splat_buffers, camera_position, 112);
L4D_FIELD(l4d_splat_buffers, sh_rows, 56);
L4D_FIELD(l4d_splat_buffers, num_still, 64);
L4D_FIELD(l4d_splat_buffers, still_key, 72);
L4D_LAYOUT(l4d_splat_columns, 264);
L4D_FIELD(l4d_splat_columns, point, 248);
L4D_FIELD(l4d_splat_columns, scale, 136);
L4D_FIELD(l4d_splat_columns, color, 192);
L4D_FIELD(l4d_splat_columns, id, 216);
L4D_FIELD(l4d_splat_columns, covariance, 48);
L4D_FIELD(l4d_splat_columns, still_key, 120);
L4D_FIELD(l4d_splat_columns, min_opacity, 128);
L4D_LAYOUT(l4d_counters, 96);
L4D_FIELD(l4d_counters, pages_lost, 64);
L4D_FIELD(l4d_counters, details_lost, 88);
L4D_LAYOUT(l4d_loss, 56);
L4D_FIELD(l4d_loss, clause, 40);
L4D_FIELD(l4d_loss, detail_only, 48);
L4D_LAYOUT(l4d_level_limits, 88);
L4D_FIELD(l4d_level_limits, memory_bytes, 64);
L4D_FIELD(l4d_level_limits, symbols_per_second, 80);
L4D_LAYOUT(l4d_stream_demand, 160);
L4D_FIELD(l4d_stream_demand, instant_bytes, 32);
L4D_FIELD(l4d_stream_demand, table_bytes, 64);
L4D_FIELD(l4d_stream_demand, min_burst_bytes, 96);
L4D_FIELD(l4d_stream_demand, min_bytes_per_second, 120);
L4D_FIELD(l4d_stream_demand, min_symbols_per_second, 152);
L4D_LAYOUT(l4d_dequantization, 48);
L4D_FIELD(l4d_dequantization, log_scale_t, 40);
L4D_LAYOUT(l4d_violation, 40);
L4D_FIELD(l4d_violation, clause, 16);
L4D_LAYOUT(l4d_encoder_options, 24);
L4D_LAYOUT(l4d_importance, 96);
L4D_FIELD(l4d_importance, weights, 24);
L4D_FIELD(l4d_importance, min_sizes, 88);
L4D_LAYOUT(l4d_parameter_info, 72);
L4D_FIELD(l4d_parameter_info, initial, 48);
L4D_FIELD(l4d_parameter_info, stable, 68);
L4D_LAYOUT(l4d_encode_step, 16);
L4D_LAYOUT(l4d_encode_report, 152);
L4D_FIELD(l4d_encode_report, steps, 144);
L4D_FIELD(l4d_encode_report, total_seconds, 72);
L4D_FIELD(l4d_encode_report, max_opacity_error, 104);
L4D_FIELD(l4d_encode_report, max_mean_t_error, 120);
L4D_FIELD(l4d_encode_report, max_directional_color_error, 136);
#endif
static_assert(sizeof(l4d_status) == 4);

// Numbers that files, scripts and compiled programs hold.
TEST(Layout, ConstantsKeepTheirValues) {
  EXPECT_EQ(L4D_ERR_INVALID_ARGUMENT, -1);
  EXPECT_EQ(L4D_ERR_CORRUPT, -14);
  EXPECT_EQ(L4D_ERR_INTERNAL, -99);
  EXPECT_EQ(L4D_COMPONENT_SH, 0);
  EXPECT_EQ(L4D_COMPONENT_ROTOR_TEMPORAL, 3);
  EXPECT_EQ(L4D_TOOL_LOSSLESS, 1u << 6);
  EXPECT_EQ(L4D_SECTION_ROTOR_TEMPORAL, 12);
  EXPECT_EQ(L4D_SECTION_ENTROPY_TABLES, 13);
  EXPECT_EQ(L4D_TOOL_RANS, 1u << 8);
  EXPECT_EQ(L4D_TOOL_SH_BASE, 1u << 9);
  EXPECT_EQ(L4D_DETAIL_BASE_COLOR, 1);
  EXPECT_EQ(L4D_SENSITIVITY_GAUSS_NEWTON, 1);
  EXPECT_EQ(L4D_WEIGHT_VIEWS_SOME, 2);
  EXPECT_EQ(L4D_PROFILE_LOSSLESS, 3);
  EXPECT_EQ(L4D_WEIGHT_MEAN_T, 7);
  EXPECT_EQ(L4D_WEIGHT_ALPHA_T, 4);
  EXPECT_EQ(L4D_QUERY_RANGE, 2);
  EXPECT_EQ(L4D_MAX_STAGES, 8);
}

// struct_size comes first in every struct that has one.
TEST(Layout, StructSizeComesFirst) {
  EXPECT_EQ(offsetof(l4d_reader, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_gaussians, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_decoder_options, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_info, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_query, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_gaussian_buffers, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_packed_buffers, struct_size), 0u);
  EXPECT_EQ(offsetof(l4d_encode_report, struct_size), 0u);
}

}  // namespace
