// SPDX-License-Identifier: Apache-2.0
// What a scene states of itself, as texts by key. Comments of PLY files and the metadata of raw
// arrays have this form; docs/formats.md lists the keys.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "io/scene/scene.h"

namespace l4d::io {

// The text of a key; nullptr if the file does not have it.
using TextOf = std::function<const char*(const std::string& key)>;

// The number that is the whole text of a key; `fallback` if there is none. Throws Error.
double stated_number(const TextOf& text_of, const std::string& key, double fallback);
// Whether placement, clock, rendering and presentation have this key.
bool is_statement(const std::string& key);
// Sets the frame rate from `fps`, a decimal or a fraction such as 30000/1001; 30 without it.
void read_stated_fps(const TextOf& text_of, l4d_timeline* timeline);
// Placement, rendering and presentation. Throws Error with L4D_ERR_CORRUPT, or with
// L4D_ERR_FEATURE_UNSUPPORTED if a word is unknown.
void read_stated_placement(const TextOf& text_of, Scene* scene);

// The clock, as lines "key text".
std::vector<std::string> clock_statements(const l4d_timeline& timeline);
// The same of placement, rendering and presentation: what differs from the defaults.
std::vector<std::string> placement_statements(const l4d_placement& placement,
                                              const l4d_rendering& rendering,
                                              const l4d_presentation& presentation);
// What a writer did to a scene, a sentence each, with the number of Gaussians that it speaks of, or
// 0 where it speaks of all.
using WriteNotes = std::map<std::string, uint64_t>;

// Notes the lines of `statements` that `format` has no place for; nothing where there is none.
void note_lost_statements(const std::string& format, const std::vector<std::string>& statements,
                          WriteNotes* notes);
// "time_begin T" if the clock of the scene does not begin at 0.
std::vector<std::string> begin_statements(const l4d_timeline& timeline);

// The shortest decimal that reads back as the same number, whatever the locale.
std::string text_of_number(double value);

}  // namespace l4d::io
