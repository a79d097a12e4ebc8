// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/judgement.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "cli/command/levels.h"
#include "cli/text/units.h"
#include "l4d/experimental/inspect.h"

namespace l4d::cli {

void collect(void* user, const l4d_violation* violation) {
  auto& found = *static_cast<Found*>(user);
  if (violation->status == L4D_ERR_NOT_L4D || violation->status == L4D_ERR_VERSION_UNSUPPORTED ||
      violation->status == L4D_ERR_FEATURE_UNSUPPORTED) {
    found.unreadable = violation->status;
  }
  if (found.errors.size() >= found.max_errors) return;
  const bool has_offset = violation->offset != UINT64_MAX;
  const uint64_t at = violation->offset + found.base;
  found.errors.push_back({{"clause", violation->clause},
                          {"offset", has_offset ? Json(at) : Json()},
                          {"message", violation->message},
                          {"status", l4d_status_name(violation->status)}});
  const std::string clause = *violation->clause == '\0' ? "-" : violation->clause;
  const std::string offset = has_offset ? std::to_string(at) : "-";
  found.text +=
      format("  %-10s byte %-12s %s\n", clause.c_str(), offset.c_str(), violation->message);
}

Judgement judge(const DecoderHandle& decoder, const Claim& claim, uint64_t base) {
  const l4d_info info = decoder.info();
  l4d_stream_demand c = L4D_INIT(l4d_stream_demand);
  // Once for what the stream keeps to, then for the link of the level in question.
  decoder.check(l4d_decoder_get_stream_demand(decoder.get(), &c));
  const uint32_t level = claim.level != 0                                  ? claim.level
                         : info.level != 0 && info.level <= L4D_NUM_LEVELS ? info.level
                         : c.level != 0                                    ? c.level
                                                                           : L4D_NUM_LEVELS;
  const l4d_level_limits limits = limits_of_level(level, c.profile);
  c.bytes_per_second = limits.bytes_per_second;
  c.burst_bytes = limits.burst_bytes;
  c.burst_symbols = limits.instant_symbols;
  decoder.check(l4d_decoder_get_stream_demand(decoder.get(), &c));

  Found found;
  found.max_errors = UINT64_MAX;
  found.base = base;
  uint64_t violations = 0;
  decoder.check(l4d_decoder_check_conformance(decoder.get(), claim.profile, claim.level, &collect,
                                              &found, &violations));
  Judgement out;
  out.holds = violations == 0;
  out.profile = c.profile;
  out.level = c.level;
  const auto quantity = [&](const char* name, uint64_t value, uint64_t limit,
                            std::optional<double> time, const Json& more = Json::object()) {
    Json q = {{"name", name}, {"value", value}, {"limit", limit}, {"holds", value <= limit}};
    if (time) q["time"] = *time;
    q.update(more);
    out.json["quantities"].push_back(q);
    const std::string when = time ? "  at " + format_time(*time) + " s" : "";
    out.text +=
        format("  %-18s %16s of %16s%s%s\n", name, format_count(value).c_str(),
               format_count(limit).c_str(), when.c_str(), value <= limit ? "" : "  too many");
  };
  const auto name_or_null = [](uint32_t profile) {
    return profile == 0 ? Json() : Json(profile_text(profile));
  };
  out.json = {{"declared_profile", name_or_null(info.profile)},
              {"declared_level", info.level},
              {"profile", name_or_null(c.profile)},
              {"level", c.level},
              {"requested_profile", name_or_null(claim.profile)},
              {"requested_level", claim.level},
              {"holds", out.holds},
              {"violations", found.errors},
              {"limits_of_level", level},
              {"quantities", Json::array()}};
  out.text = "declares profile " + profile_text(info.profile) + ", level " +
             level_text(info.level) + "; keeps to profile " + profile_text(c.profile) + ", level " +
             level_text(c.level) + "\n";
  if (claim.profile != 0 || claim.level != 0) {
    out.text += "claimed:";
    if (claim.profile != 0) out.text += " profile " + profile_text(claim.profile);
    if (claim.level != 0) out.text += " level " + level_text(claim.level);
    out.text += out.holds ? ": holds\n" : ": does not hold\n" + found.text;
  }
  out.text += "limits of level " + level_text(level) + "\n";
  quantity("instant_gaussians", c.instant_gaussians, limits.instant_gaussians,
           c.instant_gaussians_time);
  quantity("table_bytes", c.table_bytes, limits.table_bytes, {});
  quantity("instant_bytes", c.instant_bytes, limits.instant_bytes, c.instant_bytes_time);
  quantity("start_bytes", c.start_bytes, limits.start_bytes, {});
  quantity("burst_bytes", c.min_burst_bytes, limits.burst_bytes, c.window_begin,
           {{"time_end", c.window_end}, {"bytes_per_second", c.bytes_per_second}});
  quantity("memory_bytes", c.memory_bytes, limits.memory_bytes, c.memory_time);
  quantity("instant_symbols", c.instant_symbols, limits.instant_symbols, c.instant_symbols_time);
  // No rate is enough where an instant alone is too much, which the line above says.
  if (c.min_symbols_per_second != UINT64_MAX) {
    quantity("symbols_per_second", c.min_symbols_per_second, limits.symbols_per_second, {},
             {{"burst_symbols", c.burst_symbols}});
  }
  out.json["min_bytes_per_second"] =
      c.min_bytes_per_second == UINT64_MAX ? Json() : Json(c.min_bytes_per_second);
  return out;
}

namespace {

constexpr uint32_t kNumProfiles = L4D_PROFILE_LOSSLESS;
constexpr size_t kNumQuantities = 8;
constexpr const char* kQuantities[kNumQuantities] = {
    "instant_gaussians", "table_bytes",  "instant_bytes",   "start_bytes",
    "burst_bytes",       "memory_bytes", "instant_symbols", "symbols_per_second"};
using Quantities = std::array<uint64_t, kNumQuantities>;

Quantities limits_at(uint32_t level, uint32_t profile) {
  const l4d_level_limits l = limits_of_level(level, profile);
  return {l.instant_gaussians, l.table_bytes,  l.instant_bytes,   l.start_bytes,
          l.burst_bytes,       l.memory_bytes, l.instant_symbols, l.symbols_per_second};
}

// What a stream asks for over the link of a level.
Quantities demand_at(const DecoderHandle& decoder, uint32_t level, uint32_t profile) {
  const l4d_level_limits limits = limits_of_level(level, profile);
  l4d_stream_demand d = L4D_INIT(l4d_stream_demand);
  d.bytes_per_second = limits.bytes_per_second;
  d.burst_bytes = limits.burst_bytes;
  d.burst_symbols = limits.instant_symbols;
  decoder.check(l4d_decoder_get_stream_demand(decoder.get(), &d));
  return {d.instant_gaussians, d.table_bytes,  d.instant_bytes,   d.start_bytes,
          d.min_burst_bytes,   d.memory_bytes, d.instant_symbols, d.min_symbols_per_second};
}

uint64_t add_up(uint64_t a, uint64_t b) { return a > UINT64_MAX - b ? UINT64_MAX : a + b; }

bool meets_profile(const DecoderHandle& decoder, uint32_t profile) {
  uint64_t violations = 0;
  decoder.check(
      l4d_decoder_check_conformance(decoder.get(), profile, 0, nullptr, nullptr, &violations));
  return violations == 0;
}

// What all members together ask for.
class Presentation {
 public:
  void add(const MemberInfo& m, const DecoderHandle& decoder, const Judgement& judged) {
    Asked& asked = asked_[m.member.number];
    asked.member = &m;
    const l4d_info info = decoder.info();
    for (uint32_t p = 1; p <= kNumProfiles; ++p) {
      meets_[p] = meets_[p] && meets_profile(decoder, p);
    }
    asked.profile = judged.profile;
    asked.level = judged.level;
    for (uint32_t level = 1; level <= L4D_NUM_LEVELS; ++level) {
      asked.demand[level] = demand_at(decoder, level, asked.profile);
    }
    declared_profile_ = asked_.size() == 1 || declared_profile_ == info.profile ? info.profile : 0;
    lowest_declared_ = std::min(lowest_declared_, info.level);
    declared_level_ = std::max(declared_level_, info.level);
  }

  uint32_t declared_profile() const { return declared_profile_; }
  // The highest, if all declare one.
  uint32_t declared_level() const { return lowest_declared_ == 0 ? 0 : declared_level_; }
  uint32_t profile() const {
    for (uint32_t p = 1; p <= kNumProfiles; ++p) {
      if (meets_[p]) return p;
    }
    return 0;
  }
  // The lowest that each member keeps to, and each media member with those that it needs.
  uint32_t level() const {
    uint32_t level = 1;
    for (const auto& [number, asked] : asked_) {
      if (asked.level == 0) return 0;
      level = std::max(level, asked.level);
    }
    for (; level <= L4D_NUM_LEVELS; ++level) {
      if (keeps_to(level)) return level;
    }
    return 0;
  }
  bool keeps_to(uint32_t level) const {
    const Quantities limits = limits_at(level, profile());
    const Most most = most_at(level);
    for (size_t q = 0; q < kNumQuantities; ++q) {
      if (most.value[q] > limits[q]) return false;
    }
    return true;
  }

  // Of each quantity the most that a media member and those that it needs ask for together.
  struct Most {
    Quantities value{};
    std::array<uint32_t, kNumQuantities> number{};  // of the media member
  };
  Most most_at(uint32_t level) const {
    Most most;
    for (const auto& [number, asked] : asked_) {
      Quantities sum = asked.demand[level];
      for (const uint32_t need : asked.member->needs) {
        const auto it = asked_.find(need);
        if (it == asked_.end()) continue;  // of another file
        for (size_t q = 0; q < kNumQuantities; ++q) {
          sum[q] = add_up(sum[q], it->second.demand[level][q]);
        }
      }
      for (size_t q = 0; q < kNumQuantities; ++q) {
        if (sum[q] < most.value[q]) continue;
        most.value[q] = sum[q];
        most.number[q] = number;
      }
    }
    return most;
  }

 private:
  struct Asked {
    const MemberInfo* member = nullptr;
    uint32_t profile = 0, level = 0;
    std::array<Quantities, L4D_NUM_LEVELS + 1> demand{};
  };
  std::map<uint32_t, Asked> asked_;
  std::array<bool, kNumProfiles + 1> meets_ = [] {
    std::array<bool, kNumProfiles + 1> all{};
    all.fill(true);
    return all;
  }();
  uint32_t declared_profile_ = 0, declared_level_ = 0, lowest_declared_ = UINT32_MAX;
};

void describe(const Presentation& p, const Claim& claim, Judgement* out) {
  const uint32_t kept = p.level();
  const uint32_t level = claim.level != 0          ? claim.level
                         : p.declared_level() != 0 ? p.declared_level()
                         : kept != 0               ? kept
                                                   : L4D_NUM_LEVELS;
  const auto name_or_null = [](uint32_t profile) {
    return profile == 0 ? Json() : Json(profile_text(profile));
  };
  // Each member may keep to a level that they break together.
  if (claim.level != 0 && !p.keeps_to(claim.level)) out->holds = false;
  Json& j = out->json;
  j["declared_profile"] = name_or_null(p.declared_profile());
  j["declared_level"] = p.declared_level();
  j["profile"] = name_or_null(p.profile());
  j["level"] = kept;
  j["requested_profile"] = name_or_null(claim.profile);
  j["requested_level"] = claim.level;
  j["holds"] = out->holds;
  j["limits_of_level"] = level;
  j["quantities"] = Json::array();
  j["min_bytes_per_second"] = nullptr;
  out->text +=
      "all members: profile " + profile_text(p.profile()) + ", level " + level_text(kept) + "\n";
  if (claim.profile != 0 || claim.level != 0) {
    out->text += "claimed:";
    if (claim.profile != 0) out->text += " profile " + profile_text(claim.profile);
    if (claim.level != 0) out->text += " level " + level_text(claim.level);
    out->text += out->holds ? ": holds\n" : ": does not hold\n";
  }
  out->text += "limits of level " + level_text(level) +
               "; the most of a media member and those that it needs\n";
  const Quantities limits = limits_at(level, p.profile());
  const Presentation::Most most = p.most_at(level);
  for (size_t q = 0; q < kNumQuantities; ++q) {
    if (most.value[q] == UINT64_MAX) continue;
    const bool holds = most.value[q] <= limits[q];
    j["quantities"].push_back({{"name", kQuantities[q]},
                               {"value", most.value[q]},
                               {"limit", limits[q]},
                               {"holds", holds},
                               {"member", most.number[q]}});
    out->text += format("  %-18s %16s of %16s  member %u%s\n", kQuantities[q],
                        format_count(most.value[q]).c_str(), format_count(limits[q]).c_str(),
                        most.number[q], holds ? "" : "  too many");
  }
}

}  // namespace

Judgement judge_members(const MemberFile& file, const l4d_decoder_options& options,
                        const Claim& claim) {
  Judgement out;
  Presentation presentation;
  Json members = Json::array();
  Found found;
  found.max_errors = UINT64_MAX;
  for (size_t i = 0; i < file.members().size(); ++i) {
    const MemberInfo& m = file.members()[i];
    if (m.is_index()) continue;
    DecoderHandle decoder(&options);
    decoder.open(file.reader(i));
    const Judgement one = judge(decoder, claim, m.member.offset);
    presentation.add(m, decoder, one);
    out.holds = out.holds && one.holds;
    found.base = m.member.offset;
    uint64_t violations = 0;
    decoder.check(l4d_decoder_check_conformance(decoder.get(), claim.profile, claim.level, &collect,
                                                &found, &violations));
    out.text += format("member %u %s", m.member.number,
                       one.text.substr(0, one.text.find('\n') + 1).c_str());
    members.push_back({{"number", m.member.number}, {"conformance", one.json}});
  }
  describe(presentation, claim, &out);
  out.json["violations"] = found.errors;
  out.json["members"] = members;
  return out;
}

}  // namespace l4d::cli
