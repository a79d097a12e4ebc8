// SPDX-License-Identifier: Apache-2.0
#include "cli/input/shown_scene.h"

#include "cli/input/member_file.h"
#include "eval/scene/decoded_scene.h"

namespace l4d::cli {

ShownScene::ShownScene(Context& context, const Input& input, const ImportArguments& arguments,
                       bool tolerant)
    : context_(context), name_(input.name()) {
  if (input.is_scene() || !has_members(context, input)) {
    stream_ = std::make_unique<TolerantStream>(context, input, arguments, tolerant);
    return;
  }
  l4d_decoder_options options = context.decoder_options();
  options.tolerant = tolerant ? 1 : 0;
  reader_ = std::make_unique<FileReader>(input.path());
  about(input.name(),
        [&] { members_ = std::make_unique<eval::ShownMembers>(*reader_->get(), options); });
  note_unused(context, input, arguments, members_->timeline());
}

l4d_timeline ShownScene::timeline() const {
  return members_ ? members_->timeline() : stream_->info().timeline;
}

l4d_placement ShownScene::placement() const {
  return members_ ? members_->first().info().placement : stream_->info().placement;
}

const DecoderHandle& ShownScene::first() const {
  return members_ ? members_->first() : stream_->decoder();
}

l4d_rendering ShownScene::rendering() const {
  l4d_rendering rendering = L4D_INIT(l4d_rendering);
  first().check(l4d_decoder_get_rendering(first().get(), &rendering));
  return rendering;
}

l4d_presentation ShownScene::presentation() const {
  l4d_presentation presentation = L4D_INIT(l4d_presentation);
  first().check(l4d_decoder_get_presentation(first().get(), &presentation));
  return presentation;
}

uint64_t ShownScene::slice_bytes(double seconds) const {
  return members_
             ? members_->slice_bytes(seconds)
             : eval::slice_bytes(stream_->decoder(), seconds, stream_->decoder().info().sh_degree);
}

SplatArrays ShownScene::slice(double seconds, const l4d_operating_point& point,
                              LossReport* losses) {
  if (!members_) {
    SliceOptions options;
    options.point = point;
    SplatArrays arrays = stream_->decoder().slice(seconds, options);
    losses->add(stream_->decoder());
    return arrays;
  }
  SplatArrays arrays = members_->slice(seconds, point);
  has_moved_ = members_->time() != seconds;
  for (const eval::ShownMembers::Shown& s : members_->shown()) losses->add(*s.decoder, s.offset);
  for (const auto& [index, why] : members_->left_out()) {
    context_.note(name_ + ": left out is " + why);
  }
  members_->close_others();
  return arrays;
}

l4d_counters ShownScene::counters() const {
  if (members_) return members_->counters();
  l4d_counters counters = L4D_INIT(l4d_counters);
  stream_->decoder().check(l4d_decoder_get_counters(stream_->decoder().get(), &counters));
  return counters;
}

uint64_t ShownScene::buckets_decoded() const { return counters().buckets_decoded; }
uint64_t ShownScene::cache_hits() const { return counters().cache_hits; }

}  // namespace l4d::cli
