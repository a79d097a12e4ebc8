// SPDX-License-Identifier: Apache-2.0
#include "io/file/file_kind.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "io/file/file.h"
#include "io/file/unmarked.h"

namespace l4d::io {
namespace {

constexpr const char* kConvert = "`npx @playcanvas/splat-transform IN out.ply` makes a PLY of it";
constexpr const char* kExport =
    "export a PLY with the program that wrote it; docs/formats.md lists the columns";
constexpr const char* kTrain = "`l4dtrain train` makes a scene of images whose cameras are known";
constexpr const char* kUnpack = "unpack it first";

// Each kind that kMagics names, or that io/formats reads, has a row.
struct Known {
  const char* extension;
  const char* name;
  const char* way;
};
constexpr Known kKnown[] = {{".spz", "an SPZ file", kConvert},
                            {".sog", "an SOG file", kConvert},
                            {".splat", "a SPLAT file", kConvert},
                            {".ksplat", "a KSPLAT file", kConvert},
                            {".lcc", "an LCC file", kConvert},
                            {".splatv", "a SPLATV file", kExport},
                            {".4dgs", "a 4DGS file", kExport},
                            {".glb", "a glTF file", kExport},
                            {".gltf", "a glTF file", kExport},
                            {".usd", "a USD file", kExport},
                            {".usda", "a USD file", kExport},
                            {".usdc", "a USD file", kExport},
                            {".usdz", "a USD archive", kExport},
                            {".npy", "a NumPy array", kExport},
                            {".npz", "an archive of NumPy arrays", kExport},
                            {".pt", "a PyTorch checkpoint", kExport},
                            {".pth", "a PyTorch checkpoint", kExport},
                            {".ckpt", "a PyTorch checkpoint", kExport},
                            {".pkl", "a Python pickle", kExport},
                            {".safetensors", "a file of tensors", ""},
                            {".h5", "an HDF5 file", kExport},
                            {".obj", "a mesh", kExport},
                            {".png", "an image", kTrain},
                            {".jpg", "an image", kTrain},
                            {".jpeg", "an image", kTrain},
                            {".webp", "an image", kTrain},
                            {".gif", "an image", kTrain},
                            {".bmp", "an image", kTrain},
                            {".exr", "an image", kTrain},
                            {".tif", "an image", kTrain},
                            {".tiff", "an image", kTrain},
                            {".avif", "an image", kTrain},
                            {".mp4", "a video", kTrain},
                            {".mov", "a video", kTrain},
                            {".mkv", "a video", kTrain},
                            {".webm", "a video", kTrain},
                            {".avi", "a video", kTrain},
                            {".zip", "a ZIP archive", kUnpack},
                            {".gz", "a gzip file", kUnpack},
                            {".tar", "a TAR archive", kUnpack},
                            {".7z", "a 7z archive", kUnpack},
                            {".json", "a JSON file", "files of cameras are for --cameras"},
                            {".html", "a web page", "a download may have failed"},
                            {".svg", "a drawing", kTrain},
                            {".m3u8", "a playlist", "name a stream of it"}};

FileKind kind_of(const Known& known) { return {known.name, known.way, known.extension}; }

FileKind by_extension(const char* extension) { return *kind_of_extension(extension); }

// Of the first file of a ZIP archive, whose name is in its header.
FileKind of_zip(std::string_view head) {
  constexpr size_t kName = 30;
  const auto byte = [&](size_t k) { return static_cast<size_t>(static_cast<uint8_t>(head[k])); };
  const size_t size = head.size() < kName ? 0 : byte(26) + 256 * byte(27);
  const std::string_view first = head.substr(std::min(kName, head.size()), size);
  const auto ends_in = [&](std::string_view end) {
    return first.size() >= end.size() && first.substr(first.size() - end.size()) == end;
  };
  if (ends_in(".npy")) return by_extension(".npz");
  if (ends_in("data.pkl")) return by_extension(".pt");
  if (ends_in(".usdc") || ends_in(".usda")) return by_extension(".usdz");
  if (ends_in("meta.json") || ends_in(".webp")) return by_extension(".sog");
  return by_extension(".zip");
}

struct Magic {
  std::string_view bytes;
  const char* extension;
  size_t at = 0;
};
using namespace std::string_view_literals;
constexpr std::string_view kStreamMagic = "\x89L4D"sv;
constexpr Magic kMagics[] = {{"NGSP"sv, ".spz"},
                             {"\x89"
                              "4DGS"sv,
                              ".4dgs"},
                             {"Kg\0\0"sv, ".splatv"},
                             {"glTF"sv, ".glb"},
                             {"PXR-USDC"sv, ".usdc"},
                             {"#usda "sv, ".usda"},
                             {"\x93NUMPY"sv, ".npy"},
                             {"\x80\x02\x8a\x0a"sv, ".pt"},
                             {"\x89HDF\r\n\x1a\n"sv, ".h5"},
                             {"\x89PNG"sv, ".png"},
                             {"\xff\xd8\xff"sv, ".jpg"},
                             {"\x76\x2f\x31\x01"sv, ".exr"},
                             {"GIF8"sv, ".gif"},
                             {"WEBP"sv, ".webp", 8},
                             {"ftyp"sv, ".mp4", 4},
                             {"\x1a\x45\xdf\xa3"sv, ".mkv"},
                             {"<!DOCTYPE html"sv, ".html"},
                             {"<html"sv, ".html"},
                             {"#EXTM3U"sv, ".m3u8"}};

// All of whose files have one of these.
constexpr std::string_view kAlwaysMagic[] = {".glb",  ".npy", ".png", ".jpg",
                                             ".jpeg", ".exr", ".gif"};

}  // namespace

std::string lower_extension(const std::string& name) {
  std::string extension = std::filesystem::path(name).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

std::optional<FileKind> kind_of_extension(const std::string& extension) {
  for (const Known& known : kKnown) {
    if (extension == known.extension) return kind_of(known);
  }
  return std::nullopt;
}

bool is_ply(const std::string& path) {
  const FileHandle file(std::fopen(path.c_str(), "rb"));
  if (!file) throw Error(L4D_ERR_IO, path + ": cannot open: " + std::strerror(errno));
  char magic[4] = {};
  return std::fread(magic, 1, sizeof(magic), file.get()) == sizeof(magic) &&
         std::memcmp(magic, "ply", 3) == 0 && (magic[3] == '\n' || magic[3] == '\r');
}

bool is_stream(const std::string& path) {
  const FileHandle file(std::fopen(path.c_str(), "rb"));
  if (!file) throw Error(L4D_ERR_IO, path + ": cannot open: " + std::strerror(errno));
  char magic[kStreamMagic.size()];
  return std::fread(magic, 1, sizeof(magic), file.get()) == sizeof(magic) &&
         std::string_view(magic, sizeof(magic)) == kStreamMagic;
}

std::optional<FileKind> identify_file(const std::string& path, const std::string& name) {
  const FileHandle file(std::fopen(path.c_str(), "rb"));
  if (!file) throw Error(L4D_ERR_IO, path + ": cannot open: " + std::strerror(errno));
  std::array<char, 1024> bytes;
  const std::string_view head(bytes.data(), std::fread(bytes.data(), 1, bytes.size(), file.get()));
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(path, error);
  const std::string extension = lower_extension(name);
  // Its first byte may be anything, and so a byte that others begin with.
  const bool is_splat = !error && looks_like_splat(head, size);
  if (is_splat && extension == ".splat") return by_extension(".splat");
  const auto begins = [&](std::string_view magic) { return head.substr(0, magic.size()) == magic; };
  if (begins("ply") || begins(kStreamMagic)) return std::nullopt;
  for (const Magic& magic : kMagics) {
    if (head.size() > magic.at && head.substr(magic.at, magic.bytes.size()) == magic.bytes) {
      return by_extension(magic.extension);
    }
  }
  if (!error && looks_like_ksplat(head, size)) return by_extension(".ksplat");
  if (is_splat) {
    return FileKind{"a SPLAT file by its numbers", "it is read under a name that ends in .splat",
                    ""};
  }
  if (begins("PK\x03\x04")) return extension == ".sog" ? by_extension(".sog") : of_zip(head);
  if (begins("\x1f\x8b")) {
    const bool is_spz = extension == ".spz" || is_gzip_of(head, "NGSP");
    return by_extension(is_spz ? ".spz" : ".gz");
  }
  if (begins("version https://git-lfs")) {
    return FileKind{"a pointer of Git LFS and not the file itself", "`git lfs pull` fetches that",
                    ""};
  }
  if (head.size() > 9 && head.substr(8, 2) == "{\"") return by_extension(".safetensors");
  const size_t first = head.find_first_not_of(" \t\r\n");
  if (first != std::string_view::npos && head[first] == '{') {
    if (extension == ".gltf") return by_extension(".gltf");
    // SOG that is not in an archive.
    const bool is_meta = std::filesystem::path(name).filename() == "meta.json";
    return by_extension(is_meta ? ".sog" : ".json");
  }
  if (std::find(std::begin(kAlwaysMagic), std::end(kAlwaysMagic), extension) !=
      std::end(kAlwaysMagic)) {
    return FileKind{"not " + kind_of_extension(extension)->name + ", although its name says so",
                    "a download may have failed", ""};
  }
  return kind_of_extension(extension);
}

}  // namespace l4d::io
