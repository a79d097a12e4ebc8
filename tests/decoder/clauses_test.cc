// SPDX-License-Identifier: Apache-2.0
// Every rule that the library cites, broken alone in an otherwise valid file with repaired
// checksums: the validator names the rule, and so does a decoder that has to notice.
#include <gtest/gtest.h>

#include <cmath>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/base/ordered.h"
#include "tests/common/codec.h"
#include "tests/common/flat.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"

namespace l4d {
namespace {

using namespace test;

enum class Seen { kByDecoderToo, kByValidatorAlone };

void expect_clause(const Bytes& bytes, const char* clause, l4d_status status,
                   Seen seen = Seen::kByDecoderToo) {
  bool found = false;
  for (const Violation& v : validate(bytes)) {
    if (v.clause != clause) continue;
    EXPECT_EQ(l4d_status_name(v.status), std::string(l4d_status_name(status)));
    EXPECT_FALSE(v.message.empty());
    found = true;
  }
  EXPECT_TRUE(found) << "the validator does not report " << clause;
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  l4d_status got = L4D_OK;
  try {
    d.open_memory(bytes.data(), bytes.size());
    d.decode(all_query());
  } catch (const Error& e) {
    got = e.status();
  }
  const std::string detail = l4d_last_error_message();
  if (seen == Seen::kByValidatorAlone) {
    EXPECT_EQ(got, L4D_OK) << detail;
    return;
  }
  EXPECT_EQ(l4d_status_name(got), std::string(l4d_status_name(status))) << detail;
  EXPECT_EQ(detail.rfind(std::string("spec ") + clause + " at byte ", 0), 0u) << detail;
}

// An edit of a file whose header alone changes.
void expect_header_rule(const char* clause, const std::function<void(SceneHeader&)>& change,
                        l4d_status status = L4D_ERR_CORRUPT) {
  StreamEditor editor(rcq_file());
  change(editor.header);
  expect_clause(editor.build(), clause, status);
}

bool temporal(const LayerHeader& l) { return !l.permanent; }

// ---- file header -------------------------------------------------------------------------------

void rehash(Bytes& head) {
  store_le<uint64_t>(hash64(ByteSpan(head.data(), 32)), head.data() + 32);
}

// spec: FILE-1
TEST(Clause, FILE_1) {
  Bytes bytes = tiny_file();
  bytes[0] = 'L';
  expect_clause(bytes, "FILE-1", L4D_ERR_NOT_L4D);
  bytes = tiny_file();
  bytes.resize(39);
  expect_clause(bytes, "FILE-1", L4D_ERR_TRUNCATED);
}

// spec: FILE-2
TEST(Clause, FILE_2) {
  StreamEditor editor(tiny_file());
  editor.file.version_major = 2;
  expect_clause(editor.build(), "FILE-2", L4D_ERR_VERSION_UNSUPPORTED);
}

// spec: FILE-3
TEST(Clause, FILE_3) {
  StreamEditor editor(tiny_file());
  editor.file.flags |= 0x8000;
  expect_clause(editor.build(), "FILE-3", L4D_ERR_FEATURE_UNSUPPORTED);
}

// spec: FILE-4
TEST(Clause, FILE_4) {
  StreamEditor editor(tiny_file());
  editor.on_file_header = [](Bytes& head) { head[39] = static_cast<unsigned char>(~head[39]); };
  expect_clause(editor.build(), "FILE-4", L4D_ERR_CHECKSUM);
}

// spec: FILE-5
TEST(Clause, FILE_5) {
  StreamEditor editor(tiny_file());
  editor.on_file_header = [](Bytes& head) {
    store_le<uint64_t>(32, head.data() + 16);
    rehash(head);
  };
  expect_clause(editor.build(), "FILE-5", L4D_ERR_CORRUPT);
}

// spec: FILE-6
TEST(Clause, FILE_6) {
  StreamEditor editor(tiny_file());
  editor.on_file_header = [](Bytes& head) {
    head[24] = static_cast<unsigned char>(~head[24]);
    rehash(head);
  };
  expect_clause(editor.build(), "FILE-6", L4D_ERR_CHECKSUM);
}

// ---- scene header ------------------------------------------------------------------------------

// spec: HEAD-1
TEST(Clause, HEAD_1) {
  StreamEditor editor(tiny_file());
  editor.on_scene_header = [](Bytes& b) { b[4] = 'X'; };
  expect_clause(editor.build(), "HEAD-1", L4D_ERR_CORRUPT);
  editor.on_scene_header = [](Bytes& b) { store_le<uint32_t>(0xfffffff0u, b.data()); };
  expect_clause(editor.build(), "HEAD-1", L4D_ERR_CORRUPT);
}

// spec: HEAD-1
TEST(Clause, HEAD_1_Tables) {
  StreamEditor editor(tiny_file());
  const auto expect = [&](size_t at, uint16_t value) {
    editor.on_scene_header = [=](Bytes& b) {
      store_le<uint16_t>(value, b.data() + opacity_vtable(b) + at);
    };
    expect_clause(editor.build(), "HEAD-1", L4D_ERR_CORRUPT);
  };
  expect(0, 0);       // no room for the sizes of a vtable
  expect(0, 2);       // for one of them
  expect(2, 0);       // a table that has no room for the offset of its vtable
  expect(2, 4);       // fields beyond the size of their table
  expect(2, 0xfffe);  // a table beyond the buffer
  expect(4, 2);       // a field in the offset of the vtable
}

// spec: HEAD-2
TEST(Clause, HEAD_2) {
  expect_header_rule("HEAD-2", [](SceneHeader& h) { h.timeline.num_frames = 0; });
  expect_header_rule("HEAD-2", [](SceneHeader& h) { h.timeline.fps_den = 0; });
}

// spec: HEAD-3
TEST(Clause, HEAD_3) {
  expect_header_rule("HEAD-3", [](SceneHeader& h) { h.timeline.time_begin = 1e30; });
  expect_header_rule("HEAD-3", [](SceneHeader& h) { h.position_scale = 1e-38f; });
  expect_header_rule("HEAD-3", [](SceneHeader& h) { h.opacity.step = -1e20f; });
}

// spec: HEAD-4
TEST(Clause, HEAD_4) {
  expect_header_rule("HEAD-4", [](SceneHeader& h) { h.sh_degree = 4; });
}

// spec: HEAD-5
TEST(Clause, HEAD_5) {
  expect_header_rule("HEAD-5", [](SceneHeader& h) { ++h.num_gaussians; });
  expect_header_rule("HEAD-5", [](SceneHeader& h) { --h.num_gaussians; });
}

// spec: HEAD-6
TEST(Clause, HEAD_6) {
  expect_header_rule("HEAD-6", [](SceneHeader& h) { h.layers.back().level = 30; });
  expect_header_rule("HEAD-6", [](SceneHeader& h) {
    h.layers.clear();
    h.num_gaussians = 0;
  });
}

// spec: HEAD-7
TEST(Clause, HEAD_7) {
  const auto unsupported = L4D_ERR_FEATURE_UNSUPPORTED;
  expect_header_rule(
      "HEAD-7", [](SceneHeader& h) { h.sh.coding = ComponentCodingId{4}; }, unsupported);
  expect_header_rule(
      "HEAD-7", [](SceneHeader& h) { h.opacity.coding = ScalarCodingId{3}; }, unsupported);
  expect_header_rule(
      "HEAD-7", [](SceneHeader& h) { h.position = CoordinateCodingId{6}; }, unsupported);
  expect_header_rule(
      "HEAD-7", [](SceneHeader& h) { h.sh.stages[0].element = ElementType{2}; }, unsupported);
}

// spec: HEAD-16
TEST(Clause, HEAD_16) {
  expect_header_rule("HEAD-16", [](SceneHeader& h) { h.position = CoordinateCodingId::kNone; });
  expect_header_rule("HEAD-16", [](SceneHeader& h) { h.position = CoordinateCodingId::kRaw64; });
}

// spec: HEAD-17
TEST(Clause, HEAD_17) {
  for (const char* bad :
       {"\xff", "caf\xe9", "\xc0\x80", "\xed\xa0\x80", "\xf4\x90\x80\x80", "\xe2\x82"}) {
    expect_header_rule("HEAD-17", [=](SceneHeader& h) { h.metadata.emplace_back("a", bad); });
    expect_header_rule("HEAD-17", [=](SceneHeader& h) { h.metadata.emplace_back(bad, "a"); });
  }
  StreamEditor editor(tiny_file());
  editor.header.metadata.emplace_back("\xf4\x8f\xbf\xbf\xed\x9f\xbf", "\xc2\x80 \xe2\x82\xac");
  EXPECT_TRUE(validate(editor.build()).empty());
}

// spec: HEAD-18
TEST(Clause, HEAD_18) {
  const auto state = [](ErrorStatement e) {
    return [=](SceneHeader& h) {
      h.errors = e;
      h.errors.stated = true;
    };
  };
  ErrorStatement e;
  e.opacity = -0.5f;
  expect_header_rule("HEAD-18", state(e));
  e = ErrorStatement();
  e.covariance = 0;
  expect_header_rule("HEAD-18", state(e));
  StreamEditor editor(tiny_file());
  state(ErrorStatement())(editor.header);
  EXPECT_TRUE(validate(editor.build()).empty());
}

// spec: HEAD-19
TEST(Clause, HEAD_19) {
  expect_header_rule("HEAD-19", [](SceneHeader& h) { h.rendering.max_alpha = 1; });
  StreamEditor editor(tiny_file());
  editor.header.rendering.dilation = 16;
  EXPECT_TRUE(validate(editor.build()).empty());
}

// spec: HEAD-20
TEST(Clause, HEAD_20) {
  expect_header_rule("HEAD-20", [](SceneHeader& h) { h.presentation.has_camera = 1; });
  StreamEditor editor(tiny_file());
  editor.header.presentation.playback = 255;
  EXPECT_TRUE(validate(editor.build()).empty());
}

// spec: HEAD-8
TEST(Clause, HEAD_8) {
  StreamEditor editor(tiny_file());
  editor.on_scene_header = [](Bytes& b) { add_extension(b, 5, true); };
  expect_clause(editor.build(), "HEAD-8", L4D_ERR_FEATURE_UNSUPPORTED);
}

// spec: HEAD-9
TEST(Clause, HEAD_9) {
  expect_header_rule("HEAD-9", [](SceneHeader& h) { h.gate = 17; });
}

// spec: HEAD-10
TEST(Clause, HEAD_10) {
  expect_header_rule("HEAD-10",
                     [](SceneHeader& h) { h.layers.back().mean_t = CoordinateCodingId::kNone; });
}

// spec: HEAD-11
TEST(Clause, HEAD_11) {
  expect_header_rule("HEAD-11", [](SceneHeader& h) {
    h.layers.back().component[L4D_COMPONENT_ROTOR_TEMPORAL].coding = ComponentCodingId::kRaw32;
  });
}

// spec: HEAD-12
TEST(Clause, HEAD_12) {
  expect_header_rule("HEAD-12", [](SceneHeader& h) { h.layers[0].directory_bits = 17; });
}

// spec: HEAD-13
TEST(Clause, HEAD_13) {
  StreamEditor editor(tiny_file());
  editor.header.metadata = {{"text", std::string(5000, 'x')}, {"a", "b"}, {"c", "d"}};
  EXPECT_TRUE(validate(editor.build()).empty());
  editor.on_scene_header = share_metadata;
  expect_clause(editor.build(), "HEAD-13", L4D_ERR_CORRUPT);
}

// spec: HEAD-14
TEST(Clause, HEAD_14) {
  expect_header_rule(
      "HEAD-14", [](SceneHeader& h) { h.layers[0].scale_factor.coding = ScalarCodingId::kRaw32; });
}

// ---- codings and codebooks ---------------------------------------------------------------------

// spec: CODE-1
TEST(Clause, CODE_1) {
  expect_header_rule("CODE-1", [](SceneHeader& h) { h.opacity.bits = 17; });
}

// spec: CODE-2
TEST(Clause, CODE_2) {
  expect_header_rule("CODE-2", [](SceneHeader& h) { h.sh.stages[0].num_entries = 0; });
  expect_header_rule("CODE-2", [](SceneHeader& h) {
    h.layers.back().component[L4D_COMPONENT_SCALE].rcq.num_entries = 4097;
  });
}

// spec: CODE-3
TEST(Clause, CODE_3) {
  expect_header_rule("CODE-3", [](SceneHeader& h) { h.sh.stages.clear(); });
}

// A codebook's content with one value that is no number.
Bytes damaged_codebook(uint32_t entries, uint32_t dim) {
  Bytes raw;
  for (uint32_t k = 0; k < dim; ++k) {
    std::vector<uint16_t> column(entries, order_half(0x3c00));
    if (k == dim - 1) column.back() = order_half(0x7e00);
    const Bytes stream = packed_stream(column, 16);
    raw.insert(raw.end(), stream.begin(), stream.end());
  }
  return raw;
}

// spec: CODE-4
TEST(Clause, CODE_4) {
  StreamEditor editor(staged_file());
  EditedChunk& codebook = editor.sh_codebooks[1];
  codebook.raw = damaged_codebook(editor.header.sh.stages[1].num_entries, editor.header.sh_dim());
  expect_clause(editor.build(), "CODE-4", L4D_ERR_CORRUPT);
}

// ---- chunks ------------------------------------------------------------------------------------

// Applies an edit to each kind of chunk in turn.
void expect_chunk_rule(const char* clause, l4d_status status,
                       const std::function<void(EditedChunk&)>& change) {
  const auto with = [&](const char* kind, const std::function<EditedChunk&(StreamEditor&)>& pick) {
    SCOPED_TRACE(kind);
    StreamEditor editor(rcq_file());
    change(pick(editor));
    expect_clause(editor.build(), clause, status);
  };
  const auto place = StreamEditor(rcq_file()).find(temporal);
  with("SH codebook", [](StreamEditor& e) -> EditedChunk& { return e.sh_codebooks[0]; });
  with("codebook", [](StreamEditor& e) -> EditedChunk& {
    return e.layers.back().codebooks[L4D_COMPONENT_SCALE][0];
  });
  with("page", [&](StreamEditor& e) -> EditedChunk& { return e.at(place).pages[0]; });
  with("residual codebook",
       [](StreamEditor& e) -> EditedChunk& { return e.layers.back().rcq[L4D_COMPONENT_SCALE]; });
  with("block codebook", [](StreamEditor& e) -> EditedChunk& {
    for (EditedLayer& l : e.layers) {
      for (EditedDirectoryPage& d : l.directory) {
        if (!d.tables.empty()) return d.tables[0][L4D_COMPONENT_SCALE];
      }
    }
    throw std::runtime_error("no block");
  });
}

// spec: CHNK-1
TEST(Clause, CHNK_1) {
  expect_chunk_rule("CHNK-1", L4D_ERR_TRUNCATED, [](EditedChunk& c) { c.offset = 1u << 30; });
}

// Offsets of pages count from the payload. One that only comes back into the file by wrapping
// around at 2^64 lies outside of it. (Whether that is a stream that ends too early is a matter of
// taste.) spec: CHNK-1
TEST(Clause, CHNK_1_NoWrapAround) {
  StreamEditor page(rcq_file()), table(rcq_file());
  page.at(page.find(temporal)).pages[0].offset = ~uint64_t{0} - 10;
  for (EditedDirectoryPage& d : table.layers.back().directory) {
    if (!d.tables.empty()) d.tables[0][L4D_COMPONENT_SCALE].offset = ~uint64_t{0} - 10;
  }
  for (const Bytes& bytes : {page.build(), table.build()}) {
    const auto found = validate(bytes);
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found[0].clause, "CHNK-1");
    DecoderHandle d;
    d.open_memory(bytes.data(), bytes.size());
    EXPECT_THROW(d.decode(all_query()), Error);
    EXPECT_NE(std::string(l4d_last_error_message()).find("CHNK-1"), std::string::npos);
  }
}

// spec: CHNK-1
TEST(Clause, CHNK_1_Directory) {
  StreamEditor editor(tiny_file());
  editor.at(editor.find(temporal)).chunk.offset = 1u << 30;
  expect_clause(editor.build(), "CHNK-1", L4D_ERR_TRUNCATED);
  StreamEditor header(tiny_file());
  header.on_file_header = [](Bytes& head) {
    store_le<uint64_t>(uint64_t{1} << 63, head.data() + 16);
    rehash(head);
  };
  expect_clause(header.build(), "CHNK-1", L4D_ERR_TRUNCATED);
}

// spec: CHNK-2
TEST(Clause, CHNK_2) {
  expect_chunk_rule("CHNK-2", L4D_ERR_CHECKSUM, [](EditedChunk& c) { c.wrong_hash = true; });
  StreamEditor editor(tiny_file());
  editor.at(editor.find(temporal)).chunk.wrong_hash = true;
  expect_clause(editor.build(), "CHNK-2", L4D_ERR_CHECKSUM);
}

// spec: CHNK-3
TEST(Clause, CHNK_3) {
  expect_chunk_rule("CHNK-3", L4D_ERR_CORRUPT, [](EditedChunk& c) {
    c.codec = 0;
    c.raw_bytes = static_cast<uint32_t>(c.raw.size() - 1);
  });
}

// spec: CHNK-4
TEST(Clause, CHNK_4) {
  // Two pages of one bucket share their bytes.
  StreamEditor editor(staged_file());
  StreamEditor::Place place;
  bool found = false;
  for (size_t l = 0; l < editor.layers.size() && !found; ++l) {
    const auto& d = editor.layers[l].directory;
    if (d.empty() || !d[0].present || d[0].page.pages.size() < 2) continue;
    if (d[0].page.pages[0].bucket != d[0].page.pages[1].bucket) continue;
    place = {l, 0};
    found = true;
  }
  ASSERT_TRUE(found);
  editor.build();
  EditedDirectoryPage& d = editor.at(place);
  const uint64_t at = d.page.pages[0].chunk.offset;
  const uint64_t lost = d.page.pages[1].num_gaussians;
  const uint64_t gained = d.page.pages[0].num_gaussians;
  d.page.pages[1] = d.page.pages[0];
  d.pages[1] = d.pages[0];
  d.pages[1].offset = at;
  editor.header.num_gaussians += gained - lost;
  editor.header.layers[place.layer].num_gaussians += gained - lost;
  expect_clause(editor.build(), "CHNK-4", L4D_ERR_CORRUPT);
}

// spec: CHNK-5
TEST(Clause, CHNK_5) {
  expect_chunk_rule("CHNK-5", L4D_ERR_CORRUPT, [](EditedChunk& c) {
    c.codec = 1;
    c.stored = Bytes(40, 0x11);
  });
  expect_chunk_rule("CHNK-5", L4D_ERR_CORRUPT, [](EditedChunk& c) {
    c.codec = 1;
    c.raw_bytes = static_cast<uint32_t>(c.raw.size() - 1);
  });
}

// spec: CHNK-6
TEST(Clause, CHNK_6) {
  expect_chunk_rule("CHNK-6", L4D_ERR_FEATURE_UNSUPPORTED, [](EditedChunk& c) { c.codec = 200; });
}

// spec: CHNK-7
TEST(Clause, CHNK_7) {
  StreamEditor editor(rcq_file());
  editor.sh_codebooks[0].raw.push_back(0);
  expect_clause(editor.build(), "CHNK-7", L4D_ERR_CORRUPT);
  StreamEditor table(rcq_file());
  for (EditedDirectoryPage& d : table.layers.back().directory) {
    if (!d.tables.empty()) d.tables[0][L4D_COMPONENT_SCALE].raw.push_back(0);
  }
  expect_clause(table.build(), "CHNK-7", L4D_ERR_CORRUPT);
}

// spec: CHNK-8
TEST(Clause, CHNK_8) {
  expect_chunk_rule("CHNK-8", L4D_ERR_CORRUPT, [](EditedChunk& c) {
    c.codec = 1;
    c.raw_bytes = 0xfffffff0u;
  });
  StreamEditor editor(tiny_file());
  EditedChunk& directory = editor.at(editor.find(temporal)).chunk;
  directory.codec = 1;
  directory.raw_bytes = 0xfffffff0u;
  expect_clause(editor.build(), "CHNK-8", L4D_ERR_CORRUPT);
}

// ---- streams and pages -------------------------------------------------------------------------

// Page 0 of the first temporal layer with one stream replaced.
Bytes with_stream(const Bytes& file, const std::string& name,
                  const std::function<Bytes(const PageStream&)>& make) {
  StreamEditor editor(file);
  const auto place = editor.find(temporal);
  editor.replace_stream(place, 0, name, make(editor.stream(place, 0, name)));
  return editor.build();
}

std::vector<uint16_t> values(const PageStream& s, uint16_t all, uint16_t last) {
  std::vector<uint16_t> v(s.n, all);
  v.back() = last;
  return v;
}

// spec: STRM-1
TEST(Clause, STRM_1) {
  for (const unsigned mode : {3u, 8u, 0x40u, 0x80u}) {
    expect_clause(with_stream(staged_file(), "position.x",
                              [&](const PageStream& s) {
                                Bytes b = packed_stream(values(s, 0x8000, 0x8000), 16);
                                b[0] = static_cast<unsigned char>(mode);
                                return b;
                              }),
                  "STRM-1", L4D_ERR_CORRUPT);
  }
}

// spec: STRM-2
TEST(Clause, STRM_2) {
  StreamEditor editor(staged_file());
  Bytes& raw = editor.at(editor.find(temporal)).pages[0].raw;
  raw.pop_back();
  expect_clause(editor.build(), "STRM-2", L4D_ERR_CORRUPT);
}

// spec: STRM-3
TEST(Clause, STRM_3) {
  expect_clause(with_stream(staged_file(), "sh.depth",
                            [](const PageStream& s) { return planes_stream(values(s, 1, 16), 4); }),
                "STRM-3", L4D_ERR_CORRUPT);
}

// spec: STRM-4
TEST(Clause, STRM_4) {
  StreamEditor editor(staged_file());
  const auto place = editor.find(temporal);
  for (const PageStream& s : editor.streams(place, 0)) {
    if (s.n == 0 || s.n * s.width % 8 == 0) continue;
    Bytes stream = packed_stream(std::vector<uint16_t>(s.n, 0), s.width);
    stream.back() = static_cast<unsigned char>(stream.back() | 0x80);
    editor.replace_stream(place, 0, s.name, stream);
    expect_clause(editor.build(), "STRM-4", L4D_ERR_CORRUPT);
    return;
  }
  FAIL() << "no stream has padding";
}

// spec: STRM-6
TEST(Clause, STRM_6) {
  expect_clause(with_stream(staged_file(), "opacity",
                            [](const PageStream& s) {
                              return planes_stream(values(s, 0, 0), s.width, true);
                            }),
                "STRM-6", L4D_ERR_CORRUPT);
}

// spec: VAL-1
TEST(Clause, VAL_1) {
  for (const char* name : {"position.x", "position.z", "mean_t"}) {
    expect_clause(with_stream(staged_file(), name,
                              [](const PageStream& s) {
                                return packed_stream(values(s, 0x8000, order_half(0xfc00)), 16);
                              }),
                  "VAL-1", L4D_ERR_CORRUPT);
  }
}

// spec: VAL-2
TEST(Clause, VAL_2) {
  StreamEditor editor(staged_file());
  const auto place = editor.find(temporal);
  const size_t pages = editor.at(place).pages.size();
  for (size_t p = 0; p < pages; ++p) {
    const PageStream s = editor.stream(place, p, "sh.escape.11");
    if (s.n == 0) continue;
    editor.replace_stream(place, p, s.name,
                          packed_stream(values(s, 0x8000, order_half(0x7c00)), 16));
    expect_clause(editor.build(), "VAL-2", L4D_ERR_CORRUPT);
    return;
  }
  FAIL() << "no page has escapes";
}

// spec: VAL-4
TEST(Clause, VAL_4) {
  const auto with_value = [](const char* name, float bad) {
    return with_stream(lossless_file(), name, [&](const PageStream& s) {
      std::vector<uint32_t> v(s.n, order_float(0.5f));
      v.front() = order_float(bad);
      return packed_stream(v, 32);
    });
  };
  for (const float bad : {-0x1p-149f, std::nextafter(1.0f, 2.0f), 1e30f}) {
    expect_clause(with_value("opacity", bad), "VAL-4", L4D_ERR_CORRUPT);
  }
  for (const float bad : {std::nextafter(17.0f, 18.0f), -100.0f, 1e30f}) {
    expect_clause(with_value("scale.raw.2", bad), "VAL-4", L4D_ERR_CORRUPT);
  }
}

// spec: VAL-3
TEST(Clause, VAL_3) {
  for (const char* name : {"position.y", "mean_t", "opacity", "sh.raw.5", "scale.raw.3",
                           "rotor_spatial.raw.0", "rotor_temporal.raw.2"}) {
    for (const float bad : {HUGE_VALF, -HUGE_VALF, NAN}) {
      expect_clause(with_stream(lossless_file(), name,
                                [&](const PageStream& s) {
                                  std::vector<uint32_t> v(s.n, order_float(0.5f));
                                  v.back() = order_float(bad);
                                  return packed_stream(v, 32);
                                }),
                    "VAL-3", L4D_ERR_CORRUPT);
    }
  }
}

// spec: VQ-1
TEST(Clause, VQ_1) {
  expect_clause(with_stream(staged_file(), "sh.depth",
                            [](const PageStream& s) { return packed_stream(values(s, 1, 4), 4); }),
                "VQ-1", L4D_ERR_CORRUPT);
}

// spec: VQ-2
TEST(Clause, VQ_2) {
  expect_clause(
      with_stream(staged_file(), "sh.index.0",
                  [](const PageStream& s) { return planes_stream(values(s, 0, 255), s.width); }),
      "VQ-2", L4D_ERR_CORRUPT);
}

// spec: PAGE-1
TEST(Clause, PAGE_1) {
  StreamEditor editor(staged_file());
  editor.at(editor.find(temporal)).pages[0].raw.push_back(0);
  expect_clause(editor.build(), "PAGE-1", L4D_ERR_CORRUPT);
}

// ---- block codebooks ---------------------------------------------------------------------------

// The first directory page of rcq_file that has blocks.
StreamEditor::Place block_place(const StreamEditor& e) {
  for (size_t l = 0; l < e.layers.size(); ++l) {
    for (size_t d = 0; d < e.layers[l].directory.size(); ++d) {
      if (!e.layers[l].directory[d].tables.empty()) return {l, d};
    }
  }
  throw std::runtime_error("no block");
}

// spec: RCQ-1
TEST(Clause, RCQ_1) {
  for (const bool in_residual : {false, true}) {
    StreamEditor editor(rcq_file());
    const auto place = block_place(editor);
    EditedDirectoryPage& d = editor.at(place);
    const uint32_t n = d.page.blocks[0].tables[L4D_COMPONENT_SCALE].num_entries;
    const ComponentCoding& coding =
        editor.header.layers[place.layer].component[L4D_COMPONENT_SCALE];
    const unsigned widths[] = {bit_width(coding.stages[0].num_entries),
                               bit_width(coding.rcq.num_entries)};
    ASSERT_TRUE(widths[0] < 8 && widths[0] > 0 && widths[1] < 8 && widths[1] > 0);
    Bytes raw;
    for (unsigned column = 0; column < 2; ++column) {
      std::vector<uint16_t> v(n, 0);
      if ((column == 1) == in_residual) v[0] = 255;
      const Bytes stream = planes_stream(v, widths[column]);
      raw.insert(raw.end(), stream.begin(), stream.end());
    }
    d.tables[0][L4D_COMPONENT_SCALE].raw = raw;
    expect_clause(editor.build(), "RCQ-1", L4D_ERR_CORRUPT);
  }
}

// spec: RCQ-2
TEST(Clause, RCQ_2) {
  expect_header_rule("RCQ-2", [](SceneHeader& h) {
    h.sh.has_rcq = true;
    h.sh.rcq = h.layers.back().component[L4D_COMPONENT_SCALE].rcq;
  });
  expect_header_rule("RCQ-2", [](SceneHeader& h) {
    ComponentCoding& c = h.layers[0].component[L4D_COMPONENT_SCALE];
    c.has_rcq = true;
    c.rcq = h.layers.back().component[L4D_COMPONENT_SCALE].rcq;
  });
}

// spec: RCQ-3
TEST(Clause, RCQ_3) {
  StreamEditor editor(rcq_file());
  EditedDirectoryPage& d = editor.at(block_place(editor));
  d.page.blocks[0].tables[L4D_COMPONENT_SH].num_entries = 3;
  d.tables[0][L4D_COMPONENT_SH] = d.tables[0][L4D_COMPONENT_SCALE];
  expect_clause(editor.build(), "RCQ-3", L4D_ERR_CORRUPT);
}

// spec: RCQ-4
TEST(Clause, RCQ_4) {
  StreamEditor editor(rcq_file());
  editor.at(block_place(editor)).page.blocks[0].tables[L4D_COMPONENT_SCALE].num_entries = 65537;
  expect_clause(editor.build(), "RCQ-4", L4D_ERR_CORRUPT);
}

// spec: RCQ-5
TEST(Clause, RCQ_5) {
  StreamEditor editor(rcq_file());
  editor.at(block_place(editor)).on_bytes = [](Bytes& b) { repeat_component(b, 0); };
  expect_clause(editor.build(), "RCQ-5", L4D_ERR_CORRUPT);
}

// ---- directory ---------------------------------------------------------------------------------

void expect_directory_rule(const char* clause,
                           const std::function<void(EditedDirectoryPage&)>& change,
                           Seen seen = Seen::kByDecoderToo) {
  StreamEditor editor(rcq_file());
  change(editor.at(block_place(editor)));
  expect_clause(editor.build(), clause, L4D_ERR_CORRUPT, seen);
}

// spec: DIR-1
TEST(Clause, DIR_1) {
  StreamEditor editor(rcq_file());
  editor.layers.back().on_page_table = [](Bytes& table) {
    table[3] = static_cast<unsigned char>(~table[3]);
  };
  expect_clause(editor.build(), "DIR-1", L4D_ERR_CHECKSUM);
}

// spec: DIR-2
TEST(Clause, DIR_2_Tables) {
  StreamEditor editor(tiny_file());
  const auto place = editor.find([](const LayerHeader&) { return true; });
  for (const auto& [at, value] :
       {std::pair<size_t, uint16_t>{0, uint16_t{2}}, {2, uint16_t{4}}, {2, uint16_t{0xfffe}}}) {
    editor.at(place).on_bytes = [at = at, value = value](Bytes& b) {
      store_le<uint16_t>(value, b.data() + root_vtable(b) + at);
    };
    expect_clause(editor.build(), "DIR-2", L4D_ERR_CORRUPT);
  }
}

// Entropy tables that no page needs are no violation, even in a layer that could not use them.
// spec: RANS-6
TEST(Clause, EntropyTablesWithoutRansPages) {
  StreamEditor editor(lossless_file());
  for (size_t l = 0; l < editor.header.layers.size(); ++l) {
    editor.header.layers[l].has_entropy = true;
    editor.layers[l].entropy.raw = {1, 2, 3};
  }
  const Bytes bytes = editor.build();
  for (const Violation& v : validate(bytes)) ADD_FAILURE() << v.clause << ": " << v.message;
  EXPECT_TRUE(same_bits(decode(bytes, all_query()), decode(lossless_file(), all_query())));
}

// spec: DIR-2
TEST(Clause, DIR_2) {
  expect_directory_rule("DIR-2", [](EditedDirectoryPage& d) { ++d.says_layer; });
  expect_directory_rule("DIR-2", [](EditedDirectoryPage& d) { ++d.says_index; });
  expect_directory_rule("DIR-2",
                        [](EditedDirectoryPage& d) { d.on_bytes = [](Bytes& b) { b[4] = 'X'; }; });
}

// spec: DIR-3
TEST(Clause, DIR_3) {
  expect_directory_rule("DIR-3",
                        [](EditedDirectoryPage& d) { d.page.pages.back().bucket = 1u << 26; });
}

// spec: DIR-4
TEST(Clause, DIR_4) {
  expect_directory_rule("DIR-4", [](EditedDirectoryPage& d) { d.page.pages[0].num_gaussians = 0; });
  expect_directory_rule("DIR-4",
                        [](EditedDirectoryPage& d) { d.page.pages[0].num_gaussians = 65537; });
}

// spec: DIR-5
TEST(Clause, DIR_5) {
  StreamEditor fewer(rcq_file());
  fewer.header.num_gaussians += 1;
  fewer.header.layers.back().num_gaussians += 1;
  expect_clause(fewer.build(), "DIR-5", L4D_ERR_CORRUPT);
  StreamEditor more(rcq_file());
  more.header.num_gaussians -= 1;
  more.header.layers.back().num_gaussians -= 1;
  expect_clause(more.build(), "DIR-5", L4D_ERR_CORRUPT);
}

// spec: DIR-6
TEST(Clause, DIR_6) {
  expect_directory_rule("DIR-6", [](EditedDirectoryPage& d) {
    d.page.pages[0].block = static_cast<uint32_t>(d.page.blocks.size());
  });
}

// spec: DIR-7
TEST(Clause, DIR_7) {
  expect_directory_rule("DIR-7", [](EditedDirectoryPage& d) {
    d.page.pages[0].visible_begin = 200;
    d.page.pages[0].visible_end = 199;
  });
}

// spec: DIR-8
TEST(Clause, DIR_8) {
  expect_directory_rule("DIR-8", [](EditedDirectoryPage& d) {
    ASSERT_GE(d.page.pages.size(), 2u);
    d.page.pages[1].bucket = d.page.pages[0].bucket;
    d.page.pages[1].block = kNoBlock;
  });
}

// spec: DIR-9
TEST(Clause, DIR_9) {
  expect_directory_rule(
      "DIR-9",
      [](EditedDirectoryPage& d) { d.page.pages[0].visible_end = d.page.pages[0].visible_begin; },
      Seen::kByValidatorAlone);
  expect_directory_rule(
      "DIR-9",
      [](EditedDirectoryPage& d) { d.page.pages[0].visible_begin = d.page.pages[0].visible_end; },
      Seen::kByValidatorAlone);
}

// spec: DIR-10
TEST(Clause, DIR_10) {
  for (size_t k = 0; k < 6; ++k) {
    expect_directory_rule(
        "DIR-10",
        [&](EditedDirectoryPage& d) {
          auto& b = d.page.pages[0].bounds;
          b[k] = b[(k + 3) % 6];  // flat in one axis
        },
        Seen::kByValidatorAlone);
  }
}

// spec: DIR-11
TEST(Clause, DIR_11) {
  expect_directory_rule("DIR-11", [](EditedDirectoryPage& d) {
    d.page.blocks.resize(257);
    d.tables.resize(257);
  });
}

// spec: DIR-12
TEST(Clause, DIR_12) {
  expect_directory_rule("DIR-12",
                        [](EditedDirectoryPage& d) { d.page.pages[0].bounds[4] = 0x7c00; });
  expect_directory_rule("DIR-12", [](EditedDirectoryPage& d) {
    std::swap(d.page.pages[0].bounds[0], d.page.pages[0].bounds[3]);
  });
}

// ---- layers ------------------------------------------------------------------------------------

// spec: LAYR-1
TEST(Clause, LAYR_1) {
  StreamEditor editor(staged_file());
  const auto place = editor.find([](const LayerHeader& l) { return l.level >= 3; });
  // Three bucket widths late: beyond the neighbour, and well inside the sequence.
  ASSERT_LT(editor.at(place).page.pages[0].bucket, 8u);
  editor.replace_stream(place, 0, "mean_t", constant_stream(order_half(float_to_half(3)), 16));
  expect_clause(editor.build(), "LAYR-1", L4D_ERR_CORRUPT, Seen::kByValidatorAlone);
}

}  // namespace
}  // namespace l4d
