// SPDX-License-Identifier: Apache-2.0
// make_seeds FOLDER: writes small valid inputs for every target to FOLDER/TARGET. Made of tiny
// encodes at build time, so that they follow the format.
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>

#include "io/formats/write_4dgs.h"
#include "io/formats/write_sog.h"
#include "io/formats/write_spz.h"
#include "io/image/image.h"
#include "io/ply/scene_ply.h"
#include "io/ply/weights.h"
#include "io/synth/synth.h"
#include "l4d/experimental/copy.h"
#include "l4d/members.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/file_header.h"
#include "tests/common/jpeg.h"
#include "tests/hostile/chunk_walk.h"
#include "tests/hostile/small_files.h"

namespace {

namespace fs = std::filesystem;
using l4d::Bytes;

class Seeds {
 public:
  explicit Seeds(fs::path folder) : folder_(std::move(folder)) {}

  fs::path path(const std::string& target, const std::string& name) const {
    fs::create_directories(folder_ / target);
    return folder_ / target / name;
  }
  void write(const std::string& target, const std::string& name, const Bytes& control,
             const Bytes& content) const {
    std::ofstream out(path(target, name), std::ios::binary);
    for (const Bytes* part : {&control, &content}) {
      out.write(reinterpret_cast<const char*>(part->data()),
                static_cast<std::streamsize>(part->size()));
    }
    if (!out.flush()) throw std::runtime_error("cannot write the seed " + name);
  }
  void text(const std::string& target, const std::string& name, const std::string& content) const {
    write(target, name, {}, Bytes(content.begin(), content.end()));
  }

 private:
  fs::path folder_;
};

Bytes part(const Bytes& file, size_t offset, size_t n) {
  const auto begin = file.begin() + static_cast<std::ptrdiff_t>(offset);
  return Bytes(begin, begin + static_cast<std::ptrdiff_t>(n));
}

// What the targets of single structures get: pieces of whole files.
void write_pieces(const Seeds& seeds, const std::string& name, const Bytes& file) {
  using l4d::test::ChunkKind;
  unsigned count = 0;
  Bytes entry(l4d::PageTableEntry::kBytes, 0);
  for (const l4d::test::ChunkPlace& p : l4d::test::chunk_places(file)) {
    const std::string piece = name + "-" + std::to_string(count++);
    const Bytes bytes = part(file, p.offset, p.bytes);
    Bytes control;
    switch (p.kind) {
      case ChunkKind::kFileHeader:
        break;
      case ChunkKind::kSceneHeader:
        seeds.write("header", piece, part(file, 0, l4d::FileHeader::kBytes), bytes);
        break;
      case ChunkKind::kPageTable:
        entry = part(file, p.offset, l4d::PageTableEntry::kBytes);
        break;
      case ChunkKind::kDirectoryPage:
        for (unsigned char layer = 0; layer < 2; ++layer) {
          control = {layer, layer, 0, 0};
          control.insert(control.end(), entry.begin(), entry.end());
          seeds.write("directory", piece + (layer != 0 ? "b" : "a"), control, bytes);
        }
        break;
      case ChunkKind::kCodebook:
        // Two entries of as many numbers as the chunk has streams of five bytes.
        for (unsigned char dim = 0; dim < 5; ++dim) {
          control = {0, 1, 0, dim, 0};
          seeds.write("chunk", piece + "-" + std::to_string(dim), control, bytes);
        }
        break;
      case ChunkKind::kBlockCodebook:
        control = {1, 1, 0, 0x01, 0};
        seeds.write("chunk", piece, control, bytes);
        break;
      case ChunkKind::kPage:
        for (unsigned char choice = 0x10; choice < 0x12; ++choice) {
          control = {2, 2, 0, choice, static_cast<unsigned char>(choice + 4)};
          seeds.write("chunk", piece + "-" + std::to_string(choice), control, bytes);
        }
        control = {3, 4, 0, 16, 0};
        seeds.write("chunk", piece + "-stream", control, bytes);
        break;
      case ChunkKind::kShDetail:  // nothing without its base chunk
        break;
    }
  }
}

l4d_reader memory_reader(const Bytes& bytes) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = const_cast<Bytes*>(&bytes);
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    std::memcpy(dst, static_cast<const Bytes*>(user)->data() + offset, n);
    return static_cast<int64_t>(n);
  };
  reader.size = [](void* user) {
    return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
  };
  return reader;
}

int append(void* user, const void* src, size_t n) {
  const auto* bytes = static_cast<const unsigned char*>(src);
  auto& to = *static_cast<Bytes*>(user);
  to.insert(to.end(), bytes, bytes + n);
  return 0;
}

// A file of two members, the second of which needs the first, and an index. *first_bytes: of the
// first.
Bytes chain_of(const Bytes& stream, size_t* first_bytes) {
  const auto check = [](l4d_status status) {
    if (status != L4D_OK) throw std::runtime_error(l4d_last_error_message());
  };
  Bytes out;
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = &out;
  writer.write = append;
  const uint32_t first = 0;
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  p.is_member = 1;
  p.role = L4D_MEMBER_STANDING;
  const l4d_reader reader = memory_reader(stream);
  check(l4d_copy_member(&reader, nullptr, &p, &writer, nullptr));
  *first_bytes = out.size();
  p.role = L4D_MEMBER_MEDIA;
  p.number = 1;
  p.needs = &first;
  p.num_needs = 1;
  check(l4d_copy_member(&reader, nullptr, &p, &writer, nullptr));
  const Bytes members = out;
  const l4d_reader whole = memory_reader(members);
  l4d_members* list = nullptr;
  check(l4d_members_open(&whole, nullptr, &list));
  const l4d_status status = l4d_write_member_index(list, &writer, nullptr);
  l4d_members_destroy(list);
  check(status);
  return out;
}

// What playlist_fuzz.cc gets: the members of a chain as a playlist that ends, or is live.
void write_playlist(const Seeds& seeds, const std::string& name, const Bytes& chain,
                    size_t first_bytes) {
  const std::string first = std::to_string(first_bytes);
  const std::string second = std::to_string(chain.size() - first_bytes);
  for (const bool ends : {true, false}) {
    const std::string text =
        "#EXTM3U\n#EXT-X-VERSION:4\n#EXT-X-TARGETDURATION:2\n#EXT-X-MEDIA-SEQUENCE:0\n"
        "#EXT-X-L4D-STANDING:NUMBER=0,BEGIN=0,END=4,SHIFT=0,BYTERANGE=\"" +
        first +
        "@0\",URI=\"a.l4d\"\n#EXT-X-L4D-MEMBER:NUMBER=1,BEGIN=0,SHIFT=0,NEEDS=\"0\"\n"
        "#EXTINF:2.000000,\n#EXT-X-BYTERANGE:" +
        second + "@" + first +
        "\na.l4d\n"
        "#EXT-X-L4D-MEMBER:NUMBER=2,BEGIN=2,SHIFT=2,NEEDS=\"\"\n#EXTINF:2.000000,\n"
        "#EXT-X-BYTERANGE:" +
        first + "@0\nb.l4d\n" + (ends ? "#EXT-X-ENDLIST\n" : "");
    Bytes control = {255,
                     20,
                     static_cast<unsigned char>(text.size() & 255),
                     static_cast<unsigned char>(text.size() >> 8),
                     0,
                     ends};
    control.insert(control.end(), text.begin(), text.end());
    seeds.write("playlist", name + (ends ? "" : "-live"), control, chain);
  }
}

void write_streams(const Seeds& seeds) {
  for (const l4d::test::SmallFile& file : l4d::test::small_files()) {
    for (unsigned char flags = 0; flags < 3; ++flags) {
      seeds.write("decode", file.name + "-" + std::to_string(flags), {flags}, file.bytes);
    }
    Bytes steps(1 + 3 * 16);
    for (unsigned char k = 0; k < 16; ++k) {
      steps[1 + 3u * k] = static_cast<unsigned char>(5 * k % 7);
      steps[2 + 3u * k] = static_cast<unsigned char>(12 * (5 * k % 16));
    }
    seeds.write("session", file.name, steps, file.bytes);
    Bytes session(2 + 4 * 16, 0);
    for (unsigned k = 0; k < 16; ++k) {
      session[2 + 4 * k] = static_cast<unsigned char>(k);
      session[3 + 4 * k] = static_cast<unsigned char>(37 * k);
      session[4 + 4 * k] = static_cast<unsigned char>(64 + k);
      session[5 + 4 * k] = static_cast<unsigned char>(255 - 19 * k);
    }
    seeds.write("playback", file.name, session, file.bytes);
    session[0] = 7;
    seeds.write("playback", file.name + "-strict", session, file.bytes);
    Bytes events(3 + 29, 0);
    events[1] = 255;
    seeds.write("reader", file.name, events, file.bytes);
    events[0] = 1;
    events[1] = 3;
    seeds.write("reader", file.name + "-validate", events, file.bytes);
    seeds.write("validate", file.name, {}, file.bytes);
    size_t first_bytes = 0;
    const Bytes chain = chain_of(file.bytes, &first_bytes);
    write_playlist(seeds, file.name, chain, first_bytes);
    seeds.write("members", file.name, {}, chain);
    seeds.write("validate", file.name + std::string("-members"), {}, chain);
    write_pieces(seeds, file.name, file.bytes);
  }
}

void write_other_scenes(const Seeds& seeds, const l4d::io::Splats& splats) {
  l4d::io::write_spz(seeds.path("scenes", "spz").string(), splats, {});
  try {
    l4d::io::write_sog(seeds.path("scenes", "sog").string(), splats, {});
  } catch (const l4d::io::Error& error) {
    if (error.status() != L4D_ERR_FEATURE_UNSUPPORTED) throw;  // a build without libwebp
  }
  seeds.text("scenes", "splat", std::string(64, '\x7f'));
  // Two Gaussians without compression.
  std::string ksplat(4096 + 1024 + 2 * 44, '\0');
  ksplat[1] = ksplat[4] = ksplat[8] = 1;
  ksplat[16] = ksplat[4096] = ksplat[4100] = 2;
  seeds.text("scenes", "ksplat", ksplat + "x");
  const std::string list =
      R"([{"type": "splat", "size": 65536, "texwidth": 4096, "texheight": 1, "cameras": [{)"
      R"("position": [0, 0, -5], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 50, "fy": 50,)"
      R"( "width": 64, "height": 64}]}])";
  std::string splatv = std::string("Kg\0\0", 4) + static_cast<char>(list.size()) +
                       std::string(3, '\0') + list + std::string(64, '\x3c');
  splatv.resize(8 + list.size() + 65536);
  seeds.text("scenes", "splatv", splatv);
}

void write_scenes(const Seeds& seeds) {
  l4d::io::SynthOptions options;
  options.seconds = 0.2;
  options.gaussians = 6;
  const l4d::io::Scene scene = l4d::io::synthesize(options);
  l4d::io::write_l4d_ply(seeds.path("ply", "l4d").string(), scene);
  l4d::io::write_ftgs_ply(seeds.path("ply", "ftgs").string(), scene);
  l4d::io::write_4dgs(seeds.path("scenes", "4dgs").string(), scene);
  l4d::io::Splats splats;
  splats.position = {0, 0, 1, 1, 0, 2};
  splats.covariance = {1, 0, 0, 1, 0, 1, 0.5f, 0.1f, 0, 1, 0, 2};
  splats.opacity = {0.5f, 1};
  splats.sh = {1, 0, 0, 0, 1, 0};
  l4d::io::write_3dgs_ply(seeds.path("ply", "3dgs").string(), splats);
  write_other_scenes(seeds, splats);
  seeds.text("ply", "ascii",
             "ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar int view\n"
             "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
             "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
             "property float opacity\nproperty float scale_0\nproperty float scale_1\n"
             "property float scale_2\nproperty float rot_0\nproperty float rot_1\n"
             "property float rot_2\nproperty double rot_3\nend_header\n"
             "2 3 4\n0 1 2.5 .1 .2 .3 1e0 -3 -3 -3 1 0 0 0\n");
  std::string spacetime = "ply\nformat ascii 1.0\nelement vertex 1\n";
  std::string row;
  for (const char* name :
       {"x",        "y",        "z",        "trbf_center", "trbf_scale", "nx",       "ny",
        "nz",       "motion_0", "motion_1", "motion_2",    "motion_3",   "motion_4", "motion_5",
        "motion_6", "motion_7", "motion_8", "f_dc_0",      "f_dc_1",     "f_dc_2",   "opacity",
        "scale_0",  "scale_1",  "scale_2",  "rot_0",       "rot_1",      "rot_2",    "rot_3",
        "omega_0",  "omega_1",  "omega_2",  "omega_3"}) {
    spacetime += std::string("property float ") + name + "\n";
    row += "0.5 ";
  }
  seeds.text("ply", "stg", spacetime + "end_header\n" + row + "\n");

  l4d::io::Weights weights;
  weights.count = 3;
  weights.alpha_t = weights.sh = weights.scale = weights.rotor_spatial =
      weights.rotor_temporal = {0, 0.5f, 1};
  l4d::io::write_weights_ply(seeds.path("weights", "all").string(), weights);
  seeds.text("weights", "ascii",
             "ply\nformat ascii 1.0\ncomment l4d_weights 1\nelement vertex 2\n"
             "property float alpha_t\nproperty double weight_sh_gradient\nend_header\n1 2\n3 0\n");
}

void write_cameras(const Seeds& seeds) {
  seeds.text("cameras", "cameras",
             R"({"fps": 30, "frames": 60, "width": 64, "height": 48, "cameras": [{"id": 0,
"split": "train", "video": "cam00.mp4", "K": [[50,0,32],[0,50,24],[0,0,1]],
"w2c": [[1,0,0,0],[0,1,0,0],[0,0,1,2],[0,0,0,1]]}]})");
  seeds.text("cameras", "transforms",
             R"({"camera_angle_x": 0.7, "w": 80, "h": 60, "frames": [{"file_path": "./r_000",
"time": 0.5, "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
{"file_path": "r_001", "time": 1.0, "fl_x": 70, "cx": 40.5, "k1": 0.1,
"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]})");
  const double rows[2][17] = {{0, 1, 0, 1, 48, 1, 0, 0, 2, 64, 0, 0, -1, 3, 50, 0.5, 9},
                              {0, 1, 0, 4, 48, 1, 0, 0, 5, 64, 0, 0, -1, 6, 50, 0.5, 9}};
  std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 17), }";
  header.resize(117, ' ');
  header += '\n';
  std::string npy("\x93NUMPY\x01\0\x76\0", 10);
  npy += header;
  npy.append(reinterpret_cast<const char*>(rows), sizeof rows);
  seeds.text("cameras", "poses_bounds", npy);
}

void write_images(const Seeds& seeds) {
  l4d::io::Image image(5, 3);
  for (size_t i = 0; i < image.rgb.size(); ++i) image.rgb[i] = static_cast<float>(i) / 45;
  l4d::io::write_png(seeds.path("image", "rgb").string(), image);
  const std::string jpeg = l4d::test::jpeg_of(8, 8, std::vector<uint8_t>(192, 90), {JCS_RGB, 6});
  seeds.text("image", "jpeg", jpeg);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: make_seeds FOLDER\n");
    return 2;
  }
  try {
    const fs::path folder(argv[1]);
    fs::remove_all(folder);
    const Seeds seeds(folder);
    write_streams(seeds);
    write_scenes(seeds);
    write_cameras(seeds);
    write_images(seeds);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "make_seeds: %s\n", error.what());
    return 1;
  }
  return 0;
}
