// SPDX-License-Identifier: Apache-2.0
#include "tests/hostile/verbs.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "eval/pair/comparison.h"
#include "io/scene/scene.h"
#include "l4d/members.h"
#include "tests/common/codec.h"
#include "tests/hostile/session.h"

#ifdef L4D_TEST_RENDERER
#include "l4d/experimental/copy.h"
#include "l4d/render.hpp"
#endif

namespace l4d::test {
namespace {

constexpr double kFirstSeconds = 10;  // more than small files have

struct DestroyMembers {
  void operator()(l4d_members* m) const { l4d_members_destroy(m); }
};
using Members = std::unique_ptr<l4d_members, DestroyMembers>;

l4d_status open_members(const l4d_reader& reader, bool ignore_index, Members* out) {
  l4d_members_options options = L4D_INIT(l4d_members_options);
  options.max_memory_bytes = kSessionMemory;
  options.ignore_index = ignore_index ? 1 : 0;
  l4d_members* list = nullptr;
  const l4d_status status = l4d_members_open(&reader, &options, &list);
  out->reset(list);
  return status;
}

l4d_writer append_to(Bytes* out) {
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = out;
  writer.write = [](void* user, const void* src, size_t n) {
    const auto* bytes = static_cast<const unsigned char*>(src);
    auto& to = *static_cast<Bytes*>(user);
    to.insert(to.end(), bytes, bytes + n);
    return 0;
  };
  return writer;
}

// False where the members do not make a file, as the tool finds before it writes one.
bool write_index(Bytes* file) {
  const Bytes members = *file;
  Members list;
  if (open_members(memory_reader(members), true, &list) != L4D_OK) return false;
  l4d_members_info info = L4D_INIT(l4d_members_info);
  (void)l4d_members_get_info(list.get(), &info);
  const l4d_writer writer = append_to(file);
  return info.bytes == members.size() &&
         l4d_write_member_index(list.get(), &writer, nullptr) == L4D_OK;
}

l4d_member_parameters member_parameters(uint32_t number, double shift) {
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  p.is_member = 1;
  p.number = number;
  p.role = L4D_MEMBER_MEDIA;
  p.shift = shift;
  return p;
}

// What the member presents in seconds of its sequence.
l4d_member member_of(const l4d_reader& stream) {
  l4d_member m = L4D_INIT(l4d_member);
  Members list;
  if (open_members(stream, true, &list) == L4D_OK) (void)l4d_members_get(list.get(), 0, &m);
  return m;
}

#ifdef L4D_TEST_RENDERER
l4d_camera small_camera() {
  l4d_camera camera = L4D_INIT(l4d_camera);
  camera.width = camera.height = 16;
  camera.fx = camera.fy = 12;
  camera.cx = camera.cy = 8;
  for (size_t k = 0; k < 3; ++k) camera.world_to_camera[5 * k] = 1;
  camera.world_to_camera[11] = 5;
  return camera;
}
#endif

// The verbs over one member.
class Verbs {
 public:
  Verbs(const l4d_reader& stream, const Bytes& first, std::vector<VerbOutcome>* outcomes)
      : stream_(stream), first_(first), options_(session_options()), outcomes_(*outcomes) {}

  void run() {
    std::string broken;
    const l4d_status checked = violations(stream_, &broken);
    add("validate", checked);
    is_sound_ = checked == L4D_OK && broken.empty();
    copies();
    repair();
    look();
  }

 private:
  void add(const char* verb, l4d_status status, std::string fault = {}) {
    if (fault.empty() && status != L4D_OK && !is_refusal(status)) fault = l4d_status_name(status);
    outcomes_.push_back({verb, status, std::move(fault)});
  }

  // *first: the first rule that is broken.
  l4d_status violations(const l4d_reader& stream, std::string* first) const {
    uint64_t count = 0;
    const auto keep_first = [](void* user, const l4d_violation* v) {
      auto& to = *static_cast<std::string*>(user);
      if (to.empty()) to = std::string(v->clause) + ": " + v->message;
    };
    return l4d_validate(&stream, &options_, keep_first, first, &count);
  }

  l4d_status copy(const l4d_member_parameters& p, bool tolerant, Bytes* out) const {
    l4d_decoder_options options = options_;
    options.tolerant = tolerant ? 1 : 0;
    const l4d_writer writer = append_to(out);
    return l4d_copy_member(&stream_, &options, &p, &writer, nullptr);
  }

  // "" where a copy breaks no rule and decodes.
  std::string fault_of(const Bytes& made) const {
    std::string broken;
    const l4d_reader reader = memory_reader(made);
    const l4d_status status = violations(reader, &broken);
    if (status == L4D_ERR_LIMIT_EXCEEDED) return "";
    if (status != L4D_OK) return l4d_status_name(status);
    if (!broken.empty()) return broken;
    Session session;
    uint64_t digest = 0;
    const l4d_status decoded = session.decode_all(made, &digest);
    if (decoded == L4D_OK || decoded == L4D_ERR_LIMIT_EXCEEDED) return "";
    return std::string("decodes with ") + l4d_status_name(decoded);
  }

  void copies() {
    l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
    add_copy("remux", p, {});
    p.levels = 1;
    add_copy("remux --max-level 0", p, {});
    const l4d_member m = member_of(stream_);
    add_copy("concat", member_parameters(1, kFirstSeconds - m.sequence_begin), first_);
    l4d_member_parameters part = member_parameters(0, 0);
    part.has_edit = 1;
    const double seconds = m.sequence_end - m.sequence_begin;
    part.edit_begin = m.sequence_begin + 0.25 * seconds;
    part.edit_end = m.sequence_begin + 0.75 * seconds;
    add_copy("cut", part, {});
  }
  // before: of the file that the copy is appended to.
  void add_copy(const char* verb, const l4d_member_parameters& p, Bytes before) {
    Bytes made;
    l4d_status status = copy(p, false, &made);
    std::string broken;
    if (status == L4D_OK) {
      before.insert(before.end(), made.begin(), made.end());
      if (p.is_member != 0 && !write_index(&before)) status = L4D_ERR_CORRUPT;
    }
    if (status == L4D_OK && is_sound_) {
      const l4d_status checked = violations(memory_reader(before), &broken);
      if (checked != L4D_OK && checked != L4D_ERR_LIMIT_EXCEEDED) broken = l4d_status_name(checked);
    }
    add(verb, status, broken.empty() ? "" : "writes " + broken);
  }

  // As cli/verbs/repair.cc: what a plain copy breaks, a tolerant one leaves out.
  void repair() {
    l4d_member_parameters p = member_parameters(0, 0);
    Bytes made;
    l4d_status status = copy(p, false, &made);
    if (status == L4D_OK && fault_of(made).empty()) return add("repair", status);
    made.clear();
    status = copy(p, true, &made);
    const std::string fault = status == L4D_OK ? fault_of(made) : "";
    add("repair", status, fault.empty() ? "" : "keeps " + fault);
  }

  void look() {
    const DecoderHandle decoder(&options_);
    const l4d_status opened = l4d_decoder_open(decoder.get(), &stream_);
    add("info", opened);
    if (opened != L4D_OK) return;
    try {
      const eval::DecodedScene scene = eval::decode_scene(decoder);
      const eval::Comparison found =
          eval::compare_scenes(scene.scene, scene, eval::pair_by_content(scene.scene, scene, 1), 1);
      add("compare", L4D_OK, found.identical() ? "" : "a stream differs from itself");
    } catch (const Error& error) {
      add("compare", error.status());
    } catch (const io::Error& error) {
      add("compare", error.status());
    }
#ifdef L4D_TEST_RENDERER
    render(decoder);
#endif
  }

#ifdef L4D_TEST_RENDERER
  void render(const DecoderHandle& decoder) {
    l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
    options.threads = 1;
    options.max_memory_bytes = kSessionMemory;
    try {
      const l4d_info info = decoder.info();
      RendererHandle renderer(&options);
      renderer.set_decoder(decoder);
      renderer.set_time(info.timeline.time_begin + 0.5 * info.duration);
      const std::vector<float> image = renderer.render(small_camera());
      const bool is_image =
          std::all_of(image.begin(), image.end(), [](float v) { return std::isfinite(v); });
      add("render", L4D_OK, is_image ? "" : "pixels are not finite");
    } catch (const Error& error) {
      add("render", error.status());
    }
  }
#endif

  const l4d_reader stream_;
  const Bytes& first_;
  const l4d_decoder_options options_;
  std::vector<VerbOutcome>& outcomes_;
  bool is_sound_ = false;
};

}  // namespace

bool is_refusal(l4d_status status) {
  return (status <= L4D_ERR_NOT_L4D && status != L4D_ERR_INTERNAL) ||
         status == L4D_ERR_LIMIT_EXCEEDED;
}

Bytes chain(const std::vector<const Bytes*>& streams) {
  Bytes out;
  for (size_t i = 0; i < streams.size(); ++i) {
    const l4d_reader reader = memory_reader(*streams[i]);
    const l4d_writer writer = append_to(&out);
    const double shift = kFirstSeconds * static_cast<double>(i) - member_of(reader).sequence_begin;
    const l4d_member_parameters p = member_parameters(static_cast<uint32_t>(i), shift);
    const l4d_status status = l4d_copy_member(&reader, nullptr, &p, &writer, nullptr);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }
  return out;
}

std::vector<VerbOutcome> try_verbs(const Bytes& file, const Bytes& first) {
  std::vector<VerbOutcome> outcomes;
  Members list;
  const l4d_status opened = open_members(memory_reader(file), true, &list);
  if (opened != L4D_OK) {
    outcomes.push_back({"open", opened, is_refusal(opened) ? "" : l4d_status_name(opened)});
    return outcomes;
  }
  l4d_members_info info = L4D_INIT(l4d_members_info);
  (void)l4d_members_get_info(list.get(), &info);
  for (uint64_t i = 0; i < info.count; ++i) {
    l4d_member m = L4D_INIT(l4d_member);
    l4d_reader reader = L4D_INIT(l4d_reader);
    (void)l4d_members_get(list.get(), i, &m);
    if (m.role == L4D_MEMBER_INDEX) continue;
    if (l4d_members_get_reader(list.get(), i, &reader) != L4D_OK) continue;
    Verbs(reader, first, &outcomes).run();
  }
  return outcomes;
}

}  // namespace l4d::test
