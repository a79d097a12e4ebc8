// SPDX-License-Identifier: Apache-2.0
#include "encoder/session/session.h"

#include <algorithm>
#include <cstring>
#include <set>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/levels.h"
#include "libl4dcodec/scene/frame.h"

namespace l4d {
namespace {

// Fewer Gaussians than this are not worth a standing member: they are in each media member.
constexpr size_t kLeastStanding = 128;
// A media member needs no more standing members than this, so that who joins has few to fetch:
// what lives on of all but the largest then goes to a new one.
constexpr size_t kMostStanding = 8;
// Where the end is not known: a standing member lasts no longer, and who comes later fetches a
// later one.
constexpr double kLongestStanding = 600;
// Where the end is not known, what a standing member costs has to pay within so many seconds.
constexpr double kPayingSeconds = 60;
// What differs by this much of a frame differs by roundings of sums.
constexpr double kSeamFrames = 1e-3;

double frame_seconds(const l4d_timeline& t) {
  return static_cast<double>(t.fps_den) / static_cast<double>(t.fps_num);
}

// The profile that streams of these settings declare.
unsigned profile_of(const EncoderSettings& settings) {
  const int given = settings.get_int(Parameter::kProfile);
  if (given >= 0) return static_cast<unsigned>(given);
  for (const ProfileId p : {ProfileId::kIndexed, ProfileId::kMain, ProfileId::kLossless}) {
    EncoderSettings kept = settings;
    // To ask for a profile must not change how positions are coded.
    const double fixed = settings.codes_fixed_positions() ? 1 : 0;
    const bool is_set = kept.set(Parameter::kFixedPositions, kAllComponents, fixed).ok() &&
                        kept.set(Parameter::kProfile, kAllComponents, static_cast<double>(p)).ok();
    if (is_set && kept.check_profile().ok()) return static_cast<unsigned>(p);
  }
  return static_cast<unsigned>(ProfileId::kNone);
}

// A stream in memory.
struct MemoryStream {
  const Bytes& bytes;

  l4d_reader reader() {
    l4d_reader r{};
    r.struct_size = sizeof r;
    r.user = this;
    r.size = [](void* user) -> int64_t {
      return static_cast<int64_t>(static_cast<MemoryStream*>(user)->bytes.size());
    };
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      const Bytes& from = static_cast<MemoryStream*>(user)->bytes;
      const size_t begin = static_cast<size_t>(std::min<uint64_t>(offset, from.size()));
      const size_t count = std::min(n, from.size() - begin);
      std::memcpy(dst, from.data() + begin, count);
      return static_cast<int64_t>(count);
    };
    return r;
  }
};

uint64_t stream_of(const l4d_gaussians& g, const l4d_timeline& t) {
  const auto bytes_of = [](const auto* values, size_t n) {
    return ByteSpan(reinterpret_cast<const unsigned char*>(values), n * sizeof *values);
  };
  const uint64_t parts[3] = {hash64(bytes_of(g.position, 3 * g.count)),
                             hash64(bytes_of(g.opacity, g.count)),
                             hash64(bytes_of(&t.time_begin, 1))};
  return std::max<uint64_t>(1, hash64(bytes_of(parts, 3)));
}

}  // namespace

uint32_t Session::Grid::segment_of(double time) const {
  const auto next = std::upper_bound(begins.begin(), begins.end(), time);
  if (next != begins.end()) {
    return static_cast<uint32_t>(std::max<std::ptrdiff_t>(next - begins.begin(), 1) - 1);
  }
  const double more = (time - begins.back()) / (frames * frame_seconds(piece));
  return count() + static_cast<uint32_t>(std::min(more, 1e9));
}

uint32_t Session::longest_segment(const l4d_timeline& piece, uint32_t frames) const {
  const uint32_t longest = frames + (frames + 1) / 2;
  const double rounded = std::max(1.0, std::round(options_.segment)) + 0.5;
  const double most = std::ceil(rounded / frame_seconds(piece) - kSeamFrames);
  return static_cast<uint32_t>(std::min<double>(longest, std::max<double>(most, frames + 1.0)));
}

// A piece whose ends are no frames has ends that are rounded to them: where it meets the one before
// but for less than a frame, it begins where that ends, and ends where it would.
Session::Grid Session::make_grid(const l4d_timeline& piece) const {
  Grid grid;
  grid.piece = piece;
  const double frame = frame_seconds(piece);
  const double per_segment = std::round(options_.segment / frame);
  grid.frames =
      static_cast<uint32_t>(std::clamp(per_segment, 1.0, static_cast<double>(kMaxFrames)));
  const bool meets = std::fabs(piece.time_begin - end_) < frame;
  grid.begins.push_back(meets ? end_ : piece.time_begin);
  const double late = meets ? (end_ - piece.time_begin) / frame : 0;
  const double frames = std::round(piece.num_frames - late - kSeamFrames);
  const uint32_t longest = longest_segment(piece, grid.frames);
  for (auto left = static_cast<uint32_t>(std::max(1.0, frames)); left > 0;) {
    // What is left over is no member of its own if it is short.
    const uint32_t n = left < longest ? left : grid.frames;
    grid.num_frames.push_back(n);
    grid.begins.push_back(grid.begins.back() + sequence_duration(grid.timeline(grid.count())));
    left -= n;
  }
  return grid;
}

l4d_timeline Session::Grid::timeline(uint32_t segment) const {
  l4d_timeline t = piece;
  t.time_begin = begins[segment];
  t.num_frames = num_frames[segment];
  return t;
}

Status Session::check_piece(const EncoderInput& input) const {
  if (!planned_.empty()) {
    return Status(L4D_ERR_INVALID_STATE, "members of the piece before are not coded yet");
  }
  if (end_ == -HUGE_VAL) return {};
  if (input.timeline.time_begin <= end_ - (1 - kSeamFrames) * frame_seconds(input.timeline)) {
    return invalid_argument("a piece begins at " + std::to_string(input.timeline.time_begin) +
                            " s, before the one before it ends, at " + std::to_string(end_) + " s");
  }
  const char* other =
      difference({piece_.placement, piece_.rendering}, {input.placement, input.rendering});
  if (other == nullptr) return {};
  return invalid_argument(std::string("a piece has another ") + other + " than those before");
}

Status Session::check_memory(const EncoderInput& input, double now, size_t more) const {
  const std::vector<PooledGaussian>& rows = pool_.rows();
  const auto lives = [now](const PooledGaussian& row) { return row.shown.end > now; };
  const auto before = static_cast<size_t>(std::count_if(rows.begin(), rows.end(), lives));
  const uint64_t bytes = pool_.bytes_of(input, before + more);
  if (bytes <= options_.max_memory_bytes) return {};
  return Status(L4D_ERR_LIMIT_EXCEEDED,
                "the session would keep " + std::to_string(more) + " Gaussians of the piece and " +
                    std::to_string(before) + " of those before, which need " +
                    std::to_string(bytes) + " bytes; its limit is " +
                    std::to_string(options_.max_memory_bytes));
}

Status Session::add(const Encoder& encoder) {
  const EncoderInput& input = encoder.input();
  if (input.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "no scene is set");
  L4D_RETURN_IF_ERROR(check_piece(input));
  const bool lossless = encoder.settings().get_bool(Parameter::kLossless);
  EncoderScene prepared;
  L4D_RETURN_IF_ERROR(prepare_scene(input, encoder.settings(),
                                    static_cast<int>(encoder.options().threads), &prepared));
  const Grid grid = make_grid(input.timeline);
  L4D_RETURN_IF_ERROR(check_memory(input, grid.begins.front(), prepared.count));
  drop_past(grid.begins.front());
  L4D_RETURN_IF_ERROR(pool_.add(input, prepared, lossless));
  if (options_.stream == 0) options_.stream = stream_of(input.gaussians, input.timeline);
  piece_.gaussians.sh_degree = input.gaussians.sh_degree;
  piece_.gaussians.flags = input.gaussians.flags;
  piece_.placement = input.placement;
  piece_.rendering = input.rendering;
  piece_.presentation = input.presentation;
  plan(grid);
  return {};
}

Status Session::add_empty(const Encoder& encoder, const l4d_timeline& timeline,
                          const l4d_placement& placement) {
  EncoderInput input = piece_;
  if (end_ == -HUGE_VAL) {
    input.rendering = encoder.input().rendering;
    input.presentation = encoder.input().presentation;
  }
  input.timeline = timeline;
  input.placement = placement;
  if (!is_valid(timeline)) return invalid_argument(kTimelineRule);
  if (!is_valid(placement)) return invalid_argument("placement: origin and scale must be finite");
  L4D_RETURN_IF_ERROR(check_piece(input));
  const Grid grid = make_grid(timeline);
  drop_past(grid.begins.front());
  if (options_.stream == 0) options_.stream = stream_of(input.gaussians, timeline);
  piece_ = input;
  plan(grid);
  return {};
}

void Session::plan(const Grid& grid) {
  end_ = grid.begins.back();
  retire_standing();
  plan_standing(grid);
  plan_media(grid);
  plan_prices();
}

void Session::drop_past(double now) {
  std::vector<char> lives(pool_.count());
  for (size_t i = 0; i < lives.size(); ++i) lives[i] = pool_.rows()[i].shown.end > now;
  pool_.keep(lives);
}

// Standing members that end too early, or of which most has ended, are needed no more: what lives
// on of them is coded again.
void Session::retire_standing() {
  std::vector<size_t> alive(standing_.size());
  for (const PooledGaussian& row : pool_.rows()) {
    if (row.standing != PooledGaussian::kNoStanding) ++alive[row.standing];
  }
  keep_standing([&](const Standing& s, size_t index) {
    return s.end >= end_ && 2 * alive[index] >= s.count;
  });
}

template <typename Keep>
void Session::keep_standing(const Keep& keep) {
  std::vector<uint32_t> place(standing_.size(), PooledGaussian::kNoStanding);
  std::vector<Standing> kept;
  for (size_t s = 0; s < standing_.size(); ++s) {
    if (!keep(standing_[s], s)) continue;
    place[s] = static_cast<uint32_t>(kept.size());
    kept.push_back(standing_[s]);
  }
  for (PooledGaussian& row : pool_.rows()) {
    if (row.standing != PooledGaussian::kNoStanding) row.standing = place[row.standing];
  }
  standing_ = std::move(kept);
}

Sequence Session::shown(const PooledGaussian& row, const Grid& grid) const {
  return {std::max(row.shown.begin, grid.begins.front()), std::min(row.shown.end, options_.end)};
}

std::vector<uint32_t> Session::long_lived(const Grid& grid) const {
  std::vector<uint32_t> out;
  for (uint32_t i = 0; i < pool_.count(); ++i) {
    const PooledGaussian& row = pool_.rows()[i];
    if (row.standing != PooledGaussian::kNoStanding) continue;
    const Sequence s = shown(row, grid);
    if (!(s.begin < s.end)) continue;
    const uint32_t last = grid.segment_of(std::nextafter(s.end, s.begin));
    if (last - grid.segment_of(s.begin) + 1 >= options_.standing_segments) out.push_back(i);
  }
  return out;
}

void Session::plan_standing(const Grid& grid) {
  std::vector<uint32_t> rows = long_lived(grid);
  if (rows.size() < kLeastStanding) return;
  if (standing_.size() >= kMostStanding) {
    const auto largest =
        std::max_element(standing_.begin(), standing_.end(),
                         [](const Standing& a, const Standing& b) { return a.count < b.count; });
    keep_standing([&](const Standing& s, size_t) { return &s == &*largest; });
    rows = long_lived(grid);
  }
  const double begin = grid.begins.front();
  double end = grid.begins.back();
  for (const uint32_t i : rows) end = std::max(end, shown(pool_.rows()[i], grid).end);
  const bool ends = options_.end < HUGE_VAL;
  if (!ends) end = std::min(end, std::max(begin + kLongestStanding, grid.begins.back()));
  l4d_timeline timeline = grid.piece;
  timeline.time_begin = begin;
  timeline.num_frames = static_cast<uint32_t>(
      std::clamp(std::ceil((end - begin) / frame_seconds(timeline) - kSeamFrames), 1.0,
                 static_cast<double>(kMaxFrames)));
  Planned planned;
  planned.timeline = timeline;
  planned.price_seconds = sequence_duration(timeline);
  if (!ends) planned.price_seconds = std::min(planned.price_seconds, kPayingSeconds);
  planned.about = about(MemberRole::kStanding);
  for (const uint32_t i : rows) {
    pool_.rows()[i].standing = static_cast<uint32_t>(standing_.size());
  }
  Standing standing;
  standing.number = planned.about.number;
  standing.end = std::max(begin + sequence_duration(timeline), grid.begins.back());
  standing.count = rows.size();
  standing.density = static_cast<double>(rows.size()) / planned.price_seconds;
  standing_.push_back(standing);
  planned.rows = std::move(rows);
  planned_.push_back(std::move(planned));
}

void Session::plan_media(const Grid& grid) {
  std::vector<std::vector<uint32_t>> rows(grid.count());
  std::vector<std::set<uint32_t>> needs(grid.count());
  const double slack = kSeamFrames * frame_seconds(grid.piece);
  for (uint32_t i = 0; i < pool_.count(); ++i) {
    const PooledGaussian& row = pool_.rows()[i];
    const Sequence s = shown(row, grid);
    // Windows begin and end with frames, of which times are rounded.
    const double margin = row.lambda == 0 ? slack : 0;
    if (!(s.begin + margin < s.end - margin)) continue;
    for (uint32_t k = grid.segment_of(s.begin + margin);
         k < grid.count() && grid.begins[k] < s.end - margin; ++k) {
      if (row.standing == PooledGaussian::kNoStanding) {
        rows[k].push_back(i);
      } else {
        needs[k].insert(row.standing);
      }
    }
  }
  for (uint32_t k = 0; k < grid.count(); ++k) {
    Planned planned;
    planned.timeline = grid.timeline(k);
    planned.price_seconds = sequence_duration(planned.timeline);
    planned.about = about(MemberRole::kMedia);
    planned.density = static_cast<double>(rows[k].size()) / planned.price_seconds;
    for (const uint32_t s : needs[k]) {
      planned.about.needs.push_back(standing_[s].number);
      planned.density += standing_[s].density;
    }
    planned.rows = std::move(rows[k]);
    planned_.push_back(std::move(planned));
  }
}

// Each number that is coded may add the same squared error of the image times the seconds for which
// it does, so that errors cost the same in all members. What they add up to at an instant is that
// of all Gaussians coded for each second, in media and in standing members: of the first piece.
// Where there are more, the price rises, so that no member falls below the quality.
void Session::plan_prices() {
  double sum = 0, seconds = 0;
  for (const Planned& p : planned_) {
    if (!p.about.is(MemberRole::kMedia)) continue;
    sum += p.density * p.price_seconds;
    seconds += p.price_seconds;
  }
  if (density_ == 0) density_ = sum / seconds;
  for (Planned& p : planned_) p.shared_count = std::max(density_, p.density) * p.price_seconds;
}

Member Session::about(MemberRole role) {
  Member m;
  m.stream = options_.stream;
  m.number = number_++;
  m.role = static_cast<uint32_t>(role);
  return m;
}

// Of a member without Gaussians: what members of the same piece that have some say of the scene,
// and declare.
SceneHeader Session::empty_header(const Encoder& encoder, const Planned& planned) const {
  SceneHeader h;
  h.timeline = planned.timeline;
  h.placement = piece_.placement;
  h.rendering = piece_.rendering;
  h.presentation = piece_.presentation;
  h.sh_degree = piece_.gaussians.sh_degree;
  h.metadata = encoder.metadata();
  if (encoder.settings().get_bool(Parameter::kLossless)) {
    h.position_at_mean_time = (piece_.gaussians.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
    h.opacity_logit = (piece_.gaussians.flags & L4D_OPACITY_LOGIT) != 0;
    h.position = CoordinateCodingId::kRaw32;
    h.opacity.coding = ScalarCodingId::kRaw32;
    h.sh.coding = ComponentCodingId::kRaw32;
    h.layers.resize(1);
    h.layers[0].mean_t = CoordinateCodingId::kRaw32;
    for (ComponentCoding& c : h.layers[0].component) c.coding = ComponentCodingId::kRaw32;
  }
  h.profile = profile_of(encoder.settings());
  const int level = encoder.settings().get_int(Parameter::kLevel);
  h.conformance_level = static_cast<unsigned>(level < 0 ? 1 : level);
  return h;
}

Status Session::code(const Encoder& encoder, const Planned& planned, Bytes* out) const {
  if (planned.rows.empty()) {
    make_empty_member(empty_header(encoder, planned), planned.about, out);
    return {};
  }
  const SessionScene scene(pool_, planned.rows, planned.timeline, planned.price_seconds);
  EncoderInput input = scene.input(piece_);
  input.shared_count = planned.shared_count;
  // What is left out was chosen for the whole piece.
  EncoderSettings settings = encoder.settings();
  L4D_RETURN_IF_ERROR(settings.set(Parameter::kPruneWeight, kAllComponents, -1));
  L4D_RETURN_IF_ERROR(settings.set(Parameter::kPruneCost, kAllComponents, 0));
  Bytes stream;
  EncodeReport report;
  const auto keep = [&](const unsigned char* data, size_t n) {
    stream.insert(stream.end(), data, data + n);
    return true;
  };
  L4D_RETURN_IF_ERROR(encoder.encode_input(input, settings, keep, &report));
  CopyRequest request;
  request.is_member = true;
  request.member = planned.about;
  MemoryStream memory{stream};
  uint64_t bytes = 0;
  return copy_stream(
      memory.reader(), l4d_decoder_options{}, request,
      [&](ByteSpan more) -> Status {
        out->insert(out->end(), more.begin(), more.end());
        return {};
      },
      &bytes);
}

Status Session::next(const Encoder& encoder, const WriteFn& write, ListedMember* out) {
  *out = ListedMember();
  if (planned_.empty()) return {};
  const Planned& planned = planned_.front();
  Bytes bytes;
  L4D_RETURN_IF_ERROR(code(encoder, planned, &bytes));
  L4D_RETURN_IF_ERROR(write(bytes));
  out->offset = bytes_;
  out->bytes = bytes.size();
  out->header_hash = load_le<uint64_t>(bytes.data() + FileHeader::kBytes - sizeof(uint64_t));
  out->begin = planned.timeline.time_begin;
  out->end = out->begin + sequence_duration(planned.timeline);
  out->number = planned.about.number;
  out->role = planned.about.role;
  out->num_needs = static_cast<uint32_t>(planned.about.needs.size());
  bytes_ += bytes.size();
  planned_.pop_front();
  return {};
}

}  // namespace l4d
