// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/scene_header.h"

#include <cmath>

#include "l4d_generated.h"
#include "libl4dcodec/base/utf8.h"
#include "libl4dcodec/container/aligned_bytes.h"
#include "libl4dcodec/container/flat_check.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {
namespace {

constexpr char kIdentifier[] = "L4DH";

// ---- writing ----

fbs::ChunkRef to_fbs(const ChunkRef& c) {
  return fbs::ChunkRef(c.offset, c.hash, c.stored_bytes, c.raw_bytes, c.codec, 0);
}

flatbuffers::Offset<fbs::ScalarCoding> to_fbs(flatbuffers::FlatBufferBuilder& b,
                                              const ScalarCoding& s) {
  return fbs::CreateScalarCoding(b, static_cast<uint8_t>(s.coding), static_cast<uint8_t>(s.bits),
                                 s.offset, s.step);
}

flatbuffers::Offset<fbs::Stage> to_fbs(flatbuffers::FlatBufferBuilder& b, const StageCoding& s) {
  const fbs::ChunkRef ref = to_fbs(s.codebook);
  return fbs::CreateStage(b, s.num_entries, static_cast<uint8_t>(s.element), &ref, s.step);
}

flatbuffers::Offset<fbs::ComponentCoding> to_fbs(flatbuffers::FlatBufferBuilder& b,
                                                 const ComponentCoding& c) {
  flatbuffers::Offset<flatbuffers::Vector<flatbuffers::Offset<fbs::Stage>>> stages;
  flatbuffers::Offset<fbs::Stage> rcq;
  if (!c.stages.empty()) {
    std::vector<flatbuffers::Offset<fbs::Stage>> list;
    for (const StageCoding& s : c.stages) list.push_back(to_fbs(b, s));
    stages = b.CreateVector(list);
  }
  if (c.has_rcq) rcq = to_fbs(b, c.rcq);
  if (!c.transform()) {
    return fbs::CreateComponentCoding(b, static_cast<uint8_t>(c.coding), stages, c.escapes, rcq);
  }
  const auto basis = to_fbs(b, c.basis);
  const auto steps = b.CreateVector(c.steps);
  const auto eob_table = b.CreateVector(c.eob_table);
  return fbs::CreateComponentCoding(b, static_cast<uint8_t>(c.coding), stages, c.escapes, rcq,
                                    basis, steps, eob_table);
}

// ---- parsing ----

class HeaderParser {
 public:
  // size: of the serialised header, in bytes.
  HeaderParser(uint64_t base, size_t size, SceneHeader* out)
      : base_(base), size_(size), out_(*out) {}

  Status parse(const fbs::Header& h) {
    out_.num_gaussians = h.num_gaussians();
    L4D_RETURN_IF_ERROR(parse_timeline(h));
    L4D_RETURN_IF_ERROR(parse_frame(h));
    if (h.sh_degree() > 3) return bad("HEAD-4", "SH degree " + std::to_string(h.sh_degree()));
    out_.sh_degree = h.sh_degree();
    L4D_RETURN_IF_ERROR(parse_scalar(*h.opacity(), "opacity", &out_.opacity));
    L4D_RETURN_IF_ERROR(parse_component(*h.sh(), "sh", out_.sh_dim(), false, &out_.sh));
    if (out_.sh.has_rcq) return bad("RCQ-2", "RCQ on the global SH component");
    out_.sh_base = h.sh_base();
    if (out_.sh_base > out_.sh.coefficients()) {
      return bad("TRAN-7", std::to_string(out_.sh_base) + " base coefficients of SH, which has " +
                               std::to_string(out_.sh.coefficients()));
    }
    L4D_RETURN_IF_ERROR(parse_layers(*h.layers()));
    out_.payload_offset = h.payload_offset();
    out_.file_bytes = h.file_bytes();
    out_.profile = h.profile();
    out_.conformance_level = h.conformance_level();
    if (h.errors() != nullptr) L4D_RETURN_IF_ERROR(parse_errors(*h.errors(), &out_.errors));
    if (h.rendering() != nullptr) L4D_RETURN_IF_ERROR(parse_rendering(*h.rendering()));
    if (h.presentation() != nullptr) L4D_RETURN_IF_ERROR(parse_presentation(*h.presentation()));
    if (h.extensions() != nullptr) {
      for (const fbs::Extension* e : *h.extensions()) {
        if (e->chunk() != nullptr) out_.extension_bytes += e->chunk()->stored_bytes();
        if (e->critical() && e->id() == static_cast<uint32_t>(ExtensionId::kMember)) {
          out_.needs_members = true;
        } else if (e->critical()) {
          return Status(L4D_ERR_FEATURE_UNSUPPORTED, "HEAD-8", base_,
                        "critical extension " + std::to_string(e->id()));
        }
      }
    }
    if (h.metadata() != nullptr) {
      // Entries may share their strings, so a small header could spell out a large text.
      size_t length = 0;
      for (const fbs::KeyValue* kv : *h.metadata()) {
        length += kv->key()->size() + kv->value()->size();
        if (length > size_) return bad("HEAD-13", "metadata longer than the scene header");
        if (!is_utf8(kv->key()->string_view()) || !is_utf8(kv->value()->string_view())) {
          return bad("HEAD-17", "metadata that is not UTF-8");
        }
        out_.metadata.emplace_back(kv->key()->str(), kv->value()->str());
      }
    }
    return {};
  }

 private:
  Status bad(const char* clause, std::string message) const {
    return corrupt(clause, base_, std::move(message));
  }
  Status unknown(const std::string& what, unsigned id) const {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED, "HEAD-7", base_, what + " " + std::to_string(id));
  }

  Status parse_timeline(const fbs::Header& h) {
    out_.timeline.time_begin = h.time_begin();
    out_.timeline.num_frames = h.num_frames();
    out_.timeline.fps_num = h.fps_num();
    out_.timeline.fps_den = h.fps_den();
    if (!has_valid_frames(out_.timeline)) {
      return bad("HEAD-2", "number of frames or frame rate out of range");
    }
    if (!is_valid(out_.timeline)) return bad("HEAD-3", "time_begin is out of range");
    if (!(h.gate() > 0.0f && h.gate() <= 16.0f)) return bad("HEAD-9", "gate is not in (0, 16]");
    out_.gate = h.gate();
    return {};
  }

  Status parse_frame(const fbs::Header& h) {
    const float center[3] = {h.position_center()->x(), h.position_center()->y(),
                             h.position_center()->z()};
    const double origin[3] = {h.origin()->x(), h.origin()->y(), h.origin()->z()};
    for (int i = 0; i < 3; ++i) {
      if (!is_sound(center[i]) || !std::isfinite(origin[i]))
        return bad("HEAD-3", "position_center or origin is out of range");
      out_.position_center[i] = center[i];
      out_.placement.origin[i] = origin[i];
    }
    if (!is_sound(h.position_scale()) || h.position_scale() <= 0 ||
        !std::isfinite(h.world_scale())) {
      return bad("HEAD-3", "position_scale or world_scale is out of range");
    }
    out_.position_scale = h.position_scale();
    out_.placement.scale = h.world_scale();
    out_.placement.coordinate_system = h.coordinate_system();
    out_.placement.color_space = h.color_space();
    out_.position_at_mean_time = h.position_at_mean_time();
    out_.opacity_logit = h.opacity_logit();
    if (h.position() > static_cast<uint8_t>(CoordinateCodingId::kWindow)) {
      return unknown("position coding", h.position());
    }
    out_.position = static_cast<CoordinateCodingId>(h.position());
    if (out_.position == CoordinateCodingId::kNone || out_.position == CoordinateCodingId::kRaw64 ||
        out_.position == CoordinateCodingId::kWindow) {
      return bad("HEAD-16", "a coding that positions cannot have");
    }
    out_.position_bits = h.position_bits();
    if (out_.position == CoordinateCodingId::kFixed &&
        (out_.position_bits < 1 || out_.position_bits > kMaxPositionBits)) {
      return bad("CODE-5", "coordinates of " + std::to_string(out_.position_bits) + " bits");
    }
    return {};
  }

  Status parse_errors(const fbs::ErrorStatement& e, ErrorStatement* out) const {
    *out = {true,
            e.position(),
            e.covariance(),
            e.opacity(),
            e.visible(),
            e.mean_t(),
            e.position_bound(),
            e.covariance_bound(),
            e.opacity_bound(),
            e.visible_bound(),
            e.min_size(),
            e.own_min_sizes(),
            e.colors(),
            e.base_color(),
            e.directional_color(),
            e.base_color_bound(),
            e.directional_color_bound()};
    for (const float v :
         {out->position, out->opacity, out->visible, out->mean_t, out->position_bound,
          out->covariance_bound, out->opacity_bound, out->visible_bound, out->min_size,
          out->base_color, out->directional_color, out->base_color_bound,
          out->directional_color_bound}) {
      if (!(v >= 0) || std::isinf(v)) return bad("HEAD-18", "a stated error that no error can be");
    }
    if (!(out->covariance >= 1) || std::isinf(out->covariance)) {
      return bad("HEAD-18", "a stated factor below 1, or infinite");
    }
    return {};
  }

  Status parse_rendering(const fbs::Rendering& r) {
    l4d_rendering& out = out_.rendering;
    out.dilation = r.dilation();
    out.cutoff = r.cutoff();
    out.min_alpha = r.min_alpha();
    out.max_alpha = r.max_alpha();
    out.compensation = r.compensation();
    out.stated = 1;
    if (!is_valid(out)) return bad("HEAD-19", "a number of the rendering is out of range");
    return {};
  }

  Status parse_presentation(const fbs::Presentation& p) {
    l4d_presentation& out = out_.presentation;
    const auto copy = [](const flatbuffers::Array<double, 3>& from, double* to) {
      for (uint16_t k = 0; k < 3; ++k) to[k] = from.Get(k);
    };
    out.playback = p.playback();
    out.metres_per_unit = p.metres_per_unit();
    if (p.bounds() != nullptr) {
      out.has_bounds = 1;
      copy(*p.bounds()->min(), out.bounds_min);
      copy(*p.bounds()->max(), out.bounds_max);
    }
    if (p.camera() != nullptr) {
      out.has_camera = 1;
      copy(*p.camera()->position(), out.camera_position);
      copy(*p.camera()->target(), out.camera_target);
      copy(*p.camera()->up(), out.camera_up);
      out.camera_fov = p.camera()->fov();
    }
    if (!is_valid(out)) return bad("HEAD-20", "a number of the presentation is out of range");
    return {};
  }

  Status parse_scalar(const fbs::ScalarCoding& s, const char* what, ScalarCoding* out) const {
    if (s.coding() > static_cast<uint8_t>(ScalarCodingId::kSq)) {
      return unknown(std::string(what) + " coding", s.coding());
    }
    out->coding = static_cast<ScalarCodingId>(s.coding());
    out->bits = s.bits();
    out->offset = s.offset();
    out->step = s.step();
    if (!is_sound(s.offset()) || !is_sound(s.step())) {
      return bad("HEAD-3", std::string(what) + " offset or step is out of range");
    }
    if (out->coding == ScalarCodingId::kSq && (out->bits < 1 || out->bits > kMaxScaleBits)) {
      return bad("CODE-1", std::string(what) + " code of " + std::to_string(out->bits) + " bits");
    }
    return {};
  }

  Status parse_stage(const fbs::Stage& s, const char* what, uint32_t max_entries,
                     StageCoding* out) const {
    if (s.num_entries() < 1 || s.num_entries() > max_entries) {
      return bad("CODE-2", std::string(what) + " codebook of " + std::to_string(s.num_entries()) +
                               " entries");
    }
    if (s.element() > static_cast<uint8_t>(ElementType::kSq)) {
      return unknown(std::string(what) + " codebook element", s.element());
    }
    const bool sq = s.element() == static_cast<uint8_t>(ElementType::kSq);
    if (sq && !(s.step() >= 0x1p-20f && s.step() <= 0x1p10f)) {
      return bad("CODE-7", std::string(what) + " codebook step out of range");
    }
    out->step = sq ? s.step() : 0;
    const fbs::ChunkRef& c = *s.codebook();
    out->num_entries = s.num_entries();
    out->element = static_cast<ElementType>(s.element());
    out->codebook = {c.offset(), c.hash(), c.stored_bytes(), c.raw_bytes(), c.codec()};
    return {};
  }

  // dim: numbers of the component's vectors, were it a transform.
  Status parse_component(const fbs::ComponentCoding& c, const char* what, unsigned dim, bool rotor,
                         ComponentCoding* out) const {
    if (c.coding() > static_cast<uint8_t>(ComponentCodingId::kTransform)) {
      return unknown(std::string(what) + " coding", c.coding());
    }
    out->coding = static_cast<ComponentCodingId>(c.coding());
    if (out->transform()) return parse_transform(c, what, dim, rotor, out);
    if (!out->vq()) return {};
    const size_t stages = c.stages() == nullptr ? 0 : c.stages()->size();
    if (stages < 1 || stages > L4D_MAX_STAGES) {
      return bad("CODE-3", std::string(what) + " with " + std::to_string(stages) + " stages");
    }
    out->stages.resize(stages);
    for (size_t s = 0; s < stages; ++s) {
      L4D_RETURN_IF_ERROR(parse_stage(*c.stages()->Get(static_cast<flatbuffers::uoffset_t>(s)),
                                      what, kMaxCodebookEntries, &out->stages[s]));
    }
    out->escapes = c.escapes();
    out->has_rcq = c.rcq() != nullptr;
    if (out->has_rcq) {
      L4D_RETURN_IF_ERROR(parse_stage(*c.rcq(), what, kMaxResidualEntries, &out->rcq));
    }
    return {};
  }

  Status parse_transform(const fbs::ComponentCoding& c, const char* what, unsigned dim, bool rotor,
                         ComponentCoding* out) const {
    const std::string name(what);
    const float max_step = rotor ? 1.0f : 0x1p10f;
    const size_t steps = c.steps() == nullptr ? 0 : c.steps()->size();
    if (steps < 1 || steps > dim) {
      return bad("TRAN-1", name + " of " + std::to_string(steps) + " coefficients");
    }
    for (const float step : *c.steps()) {
      if (!(step >= 0x1p-20f && step <= max_step))
        return bad("TRAN-2", name + " step out of range");
      out->steps.push_back(step);
    }
    unsigned last = 0;
    for (unsigned i = 0; c.eob_table() != nullptr && i < c.eob_table()->size(); ++i) {
      const unsigned end = c.eob_table()->Get(i);
      if (end <= last || end > steps) return bad("TRAN-3", name + " EOB table does not ascend");
      out->eob_table.push_back(static_cast<uint8_t>(last = end));
    }
    if (last != steps)
      return bad("TRAN-3", name + " EOB table does not end at the last coefficient");
    if (c.basis() == nullptr || c.basis()->num_entries() != steps + 1) {
      return bad("TRAN-4", name + " basis does not have a row for the origin and each coefficient");
    }
    L4D_RETURN_IF_ERROR(parse_stage(*c.basis(), what, kMaxCoefficients + 1, &out->basis));
    return out->basis.element == ElementType::kF16 ? Status()
                                                   : bad("TRAN-8", name + " basis is not f16");
  }

  Status parse_layers(const flatbuffers::Vector<flatbuffers::Offset<fbs::Layer>>& layers) {
    const unsigned levels = num_layers(out_.timeline.num_frames);
    if (layers.size() == 0 || layers.size() > max_layers(out_.timeline.num_frames)) {
      return bad("HEAD-6", "no layer, or more than the levels allow");
    }
    uint64_t total = 0;
    out_.layers.resize(layers.size());
    for (size_t i = 0; i < layers.size(); ++i) {
      LayerHeader& out = out_.layers[i];
      L4D_RETURN_IF_ERROR(parse_layer(*layers.Get(static_cast<flatbuffers::uoffset_t>(i)), &out));
      if (out.level >= levels || (i > 0 && out.level < out_.layers[i - 1].level)) {
        return bad("HEAD-6", "level " + std::to_string(out.level) + " of layer " +
                                 std::to_string(i) + " is out of range or order");
      }
      if (out.num_gaussians > out_.num_gaussians - total) {
        return bad("HEAD-5", "layers hold more Gaussians than the scene");
      }
      total += out.num_gaussians;
    }
    if (total != out_.num_gaussians)
      return bad("HEAD-5", "layers hold fewer Gaussians than the scene");
    return {};
  }

  Status parse_mean_t(const fbs::Layer& l, LayerHeader* out) const {
    if (l.mean_t_bits() < 1 || l.mean_t_bits() > kMaxMeanBits) {
      return bad("TIME-1", std::to_string(l.mean_t_bits()) + " bits of mean times");
    }
    if (!(l.mean_t_step() >= 0x1p-60f && l.mean_t_step() <= 0x1p60f)) {
      return bad("TIME-2", "mean_t_step is out of range");
    }
    out->mean_t_bits = l.mean_t_bits();
    out->mean_t_zero = l.mean_t_zero();
    out->mean_t_step = l.mean_t_step();
    out->mean_t_fine = l.mean_t_fine();
    return {};
  }

  Status parse_windows(const fbs::Layer& l, LayerHeader* out) const {
    if (l.window_begin_bits() > kMaxWindowBits || l.window_length_bits() > kMaxWindowBits ||
        l.window_length() > L4D_MAX_FRAMES) {
      return bad("WIND-1", "windows of " + std::to_string(l.window_begin_bits()) + " and " +
                               std::to_string(l.window_length_bits()) + " bits, and of " +
                               std::to_string(l.window_length()) + " frames at least");
    }
    if (!tells_frames_apart(out_.timeline)) {
      return bad("WIND-2", "a sequence over 2^40 frames from time 0 has windows");
    }
    out->window_begin_bits = l.window_begin_bits();
    out->window_length_bits = l.window_length_bits();
    out->window_length = l.window_length();
    return {};
  }

  Status parse_layer(const fbs::Layer& l, LayerHeader* out) const {
    out->level = l.level();
    if (out->level >= kMaxLayers) return bad("HEAD-6", "level " + std::to_string(out->level));
    out->permanent = l.permanent();
    out->num_gaussians = l.num_gaussians();
    if (l.mean_t() > static_cast<uint8_t>(CoordinateCodingId::kWindow)) {
      return unknown("mean_t coding", l.mean_t());
    }
    out->mean_t = static_cast<CoordinateCodingId>(l.mean_t());
    if (out->permanent != (out->mean_t == CoordinateCodingId::kNone) ||
        (out->permanent && out->level != 0)) {
      return bad("HEAD-10",
                 "a permanent layer has level 0 and no mean times, and no other has none");
    }
    if (out->mean_t == CoordinateCodingId::kF16 && l.mean_t_shift() > kMaxMeanShift) {
      return bad("CODE-6", "mean_t without " + std::to_string(l.mean_t_shift()) + " bits");
    }
    out->mean_t_shift = out->mean_t == CoordinateCodingId::kF16 ? l.mean_t_shift() : 0;
    if (out->mean_t == CoordinateCodingId::kFixed) L4D_RETURN_IF_ERROR(parse_mean_t(l, out));
    if (out->flat()) L4D_RETURN_IF_ERROR(parse_windows(l, out));
    if (!is_sound(l.log_scale_t())) return bad("HEAD-3", "log_scale_t is out of range");
    out->log_scale_t = l.log_scale_t();
    L4D_RETURN_IF_ERROR(parse_scalar(*l.scale_factor(), "scale_factor", &out->scale_factor));
    const fbs::ComponentCoding* parts[] = {nullptr, l.scale(), l.rotor_spatial(),
                                           l.rotor_temporal()};
    static constexpr const char* kNames[] = {"", "scale", "rotor_spatial", "rotor_temporal"};
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      const bool rotor = c != L4D_COMPONENT_SCALE;
      const unsigned dim = rotor ? 3 : out->scale_dim();
      L4D_RETURN_IF_ERROR(parse_component(*parts[c], kNames[c], dim, rotor, &out->component[c]));
      if (out->component[c].has_rcq && out->level == 0) return bad("RCQ-2", "RCQ in level 0");
    }
    const bool raw_spatial =
        out->component[L4D_COMPONENT_ROTOR_SPATIAL].coding == ComponentCodingId::kRaw32;
    const bool raw_temporal =
        out->component[L4D_COMPONENT_ROTOR_TEMPORAL].coding == ComponentCodingId::kRaw32;
    if (raw_temporal && !raw_spatial) {
      return bad("HEAD-11", "a raw temporal rotor beside a coded spatial one");
    }
    const bool transform_spatial = out->component[L4D_COMPONENT_ROTOR_SPATIAL].transform();
    const ComponentCoding& temporal = out->component[L4D_COMPONENT_ROTOR_TEMPORAL];
    if (temporal.transform() ? !transform_spatial
                             : transform_spatial && temporal.coding != ComponentCodingId::kZero) {
      return bad("HEAD-15", "one half of a rotor is a transform, the other is not");
    }
    const bool raw_scale = out->component[L4D_COMPONENT_SCALE].coding == ComponentCodingId::kRaw32;
    if (out->scale_factor.coding == ScalarCodingId::kRaw32 && !raw_scale) {
      return bad("HEAD-14", "a raw scale factor beside a coded scale");
    }
    out->directory_bits = l.directory_bits();
    const int table_bits = bucket_bits(out->level) - static_cast<int>(out->directory_bits);
    if (out->directory_bits > kMaxDirectoryBits || table_bits > kMaxPageTableBits) {
      return bad("HEAD-12",
                 "directory pages of 2^" + std::to_string(l.directory_bits()) + " buckets");
    }
    out->page_table_offset = l.page_table_offset();
    out->raw_position = l.raw_position();
    out->tier = l.tier();
    out->symbols_per_gaussian = l.symbols_per_gaussian();
    out->has_entropy = l.entropy() != nullptr;
    if (out->has_entropy) {
      const fbs::ChunkRef& e = *l.entropy();
      out->entropy = {e.offset(), e.hash(), e.stored_bytes(), e.raw_bytes(), e.codec()};
    }
    return {};
  }

  static constexpr unsigned kMaxDirectoryBits = 16;
  static constexpr int kMaxPageTableBits = 20;
  uint64_t base_;
  size_t size_;
  SceneHeader& out_;
};

}  // namespace

Bytes serialize_scene_header(const SceneHeader& h, const std::vector<Extension>& extensions) {
  flatbuffers::FlatBufferBuilder b(4096);
  std::vector<flatbuffers::Offset<fbs::Layer>> layers;
  for (const LayerHeader& l : h.layers) {
    const auto factor = to_fbs(b, l.scale_factor);
    const auto scale = to_fbs(b, l.component[L4D_COMPONENT_SCALE]);
    const auto spatial = to_fbs(b, l.component[L4D_COMPONENT_ROTOR_SPATIAL]);
    const auto temporal = to_fbs(b, l.component[L4D_COMPONENT_ROTOR_TEMPORAL]);
    const fbs::ChunkRef entropy = to_fbs(l.entropy);
    layers.push_back(fbs::CreateLayer(
        b, static_cast<uint8_t>(l.level), l.permanent, l.num_gaussians,
        static_cast<uint8_t>(l.mean_t), l.log_scale_t, factor, scale, spatial, temporal,
        static_cast<uint8_t>(l.directory_bits), l.page_table_offset,
        static_cast<uint8_t>(l.mean_t_shift), l.has_entropy ? &entropy : nullptr, l.mean_t_step,
        static_cast<uint16_t>(l.mean_t_zero), static_cast<uint8_t>(l.mean_t_bits), l.mean_t_fine,
        l.raw_position, l.window_length, static_cast<uint8_t>(l.window_begin_bits),
        static_cast<uint8_t>(l.window_length_bits), static_cast<uint8_t>(l.tier),
        static_cast<uint8_t>(l.symbols_per_gaussian)));
  }
  const auto layer_vector = b.CreateVector(layers);
  const auto opacity = to_fbs(b, h.opacity);
  const auto sh = to_fbs(b, h.sh);
  flatbuffers::Offset<flatbuffers::Vector<flatbuffers::Offset<fbs::KeyValue>>> metadata;
  if (!h.metadata.empty()) {
    std::vector<flatbuffers::Offset<fbs::KeyValue>> list;
    for (const auto& [key, value] : h.metadata) {
      list.push_back(fbs::CreateKeyValueDirect(b, key.c_str(), value.c_str()));
    }
    metadata = b.CreateVector(list);
  }
  flatbuffers::Offset<flatbuffers::Vector<flatbuffers::Offset<fbs::Extension>>> extension_list;
  if (!extensions.empty()) {
    std::vector<flatbuffers::Offset<fbs::Extension>> list;
    for (const Extension& e : extensions) {
      const fbs::ChunkRef chunk = to_fbs(e.chunk);
      list.push_back(fbs::CreateExtension(b, e.id, e.critical, &chunk));
    }
    extension_list = b.CreateVector(list);
  }
  flatbuffers::Offset<fbs::ErrorStatement> errors;
  if (h.errors.stated) {
    const ErrorStatement& e = h.errors;
    errors = fbs::CreateErrorStatement(
        b, e.position, e.covariance, e.opacity, e.visible, e.mean_t, e.position_bound,
        e.covariance_bound, e.opacity_bound, e.visible_bound, e.min_size, e.own_min_sizes, e.colors,
        e.base_color, e.directional_color, e.base_color_bound, e.directional_color_bound);
  }
  flatbuffers::Offset<fbs::Rendering> rendering;
  if (!is_default(h.rendering)) {
    const l4d_rendering& r = h.rendering;
    rendering = fbs::CreateRendering(b, r.dilation, r.cutoff, r.min_alpha, r.max_alpha,
                                     r.compensation != 0);
  }
  flatbuffers::Offset<fbs::Presentation> presentation;
  if (!is_default(h.presentation)) {
    const l4d_presentation& p = h.presentation;
    const auto vec = [](const double(&v)[3]) { return flatbuffers::span<const double, 3>(v); };
    const fbs::Box bounds(vec(p.bounds_min), vec(p.bounds_max));
    const fbs::FirstCamera camera(vec(p.camera_position), vec(p.camera_target), vec(p.camera_up),
                                  p.camera_fov);
    presentation = fbs::CreatePresentation(
        b, static_cast<uint8_t>(p.playback), p.has_bounds != 0 ? &bounds : nullptr,
        p.has_camera != 0 ? &camera : nullptr, p.metres_per_unit);
  }
  const fbs::DVec3 origin(h.placement.origin[0], h.placement.origin[1], h.placement.origin[2]);
  const fbs::Vec3 center(h.position_center[0], h.position_center[1], h.position_center[2]);
  b.Finish(fbs::CreateHeader(
               b, h.num_gaussians, h.timeline.time_begin, h.timeline.num_frames, h.timeline.fps_num,
               h.timeline.fps_den, h.gate, &origin, h.placement.scale,
               static_cast<uint8_t>(h.placement.coordinate_system),
               static_cast<uint8_t>(h.placement.color_space), h.position_at_mean_time,
               h.opacity_logit, static_cast<uint8_t>(h.position), &center, h.position_scale,
               opacity, static_cast<uint8_t>(h.sh_degree), sh, layer_vector, h.payload_offset,
               metadata, extension_list, static_cast<uint8_t>(h.position_bits),
               static_cast<uint8_t>(h.profile), static_cast<uint8_t>(h.conformance_level),
               static_cast<uint8_t>(h.sh_base), errors, rendering, presentation, h.file_bytes),
           kIdentifier);
  return Bytes(b.GetBufferPointer(), b.GetBufferPointer() + b.GetSize());
}

Status parse_scene_header(ByteSpan unaligned, uint64_t base, SceneHeader* out) {
  const AlignedBytes bytes(unaligned);
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, 100000);
  if (!verifier.VerifyBuffer<fbs::Header>(kIdentifier) ||
      !tables_are_whole({bytes.data(), bytes.size()}, fbs::HeaderTypeTable())) {
    return corrupt("HEAD-1", base, "the scene header is no valid FlatBuffer of its schema");
  }
  *out = SceneHeader();
  return HeaderParser(base, bytes.size(), out)
      .parse(*flatbuffers::GetRoot<fbs::Header>(bytes.data()));
}

}  // namespace l4d
