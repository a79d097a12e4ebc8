// SPDX-License-Identifier: Apache-2.0
#include "io/ply/ply.h"

#include <cmath>
#include <limits>

#include "tests/io/support.h"

namespace l4d::io {
namespace {

class PlyTest : public test::IoTest {};

std::vector<float> read_column(const std::string& path, const std::string& property) {
  PlyReader reader(InputFile(path), "vertex");
  std::vector<float> values(static_cast<size_t>(reader.element().count));
  PlyColumn column;
  column.property = reader.element().find(property);
  column.to_float = values.data();
  reader.read_rows({column});
  return values;
}

const char kAllTypes[] =
    "element vertex 2\nproperty char a\nproperty uchar b\nproperty short c\nproperty ushort d\n"
    "property int e\nproperty uint f\nproperty float g\nproperty double h\nend_header\n";

std::string all_types_row(bool big_endian, int sign) {
  std::string row;
  test::append<int8_t>(row, static_cast<int8_t>(sign * 100), big_endian);
  test::append<uint8_t>(row, 200, big_endian);
  test::append<int16_t>(row, static_cast<int16_t>(sign * 30000), big_endian);
  test::append<uint16_t>(row, 60000, big_endian);
  test::append<int32_t>(row, sign * (1 << 24), big_endian);
  test::append<uint32_t>(row, 1U << 31, big_endian);
  test::append<float>(row, 0.1F, big_endian);
  test::append<double>(row, sign * 0.25, big_endian);
  return row;
}

TEST_F(PlyTest, EveryTypeInEveryFormat) {
  const std::string little =
      write("little.ply", std::string("ply\nformat binary_little_endian "
                                      "1.0\n") +
                              kAllTypes + all_types_row(false, 1) + all_types_row(false, -1));
  const std::string big =
      write("big.ply", std::string("ply\nformat binary_big_endian 1.0\n") + kAllTypes +
                           all_types_row(true, 1) + all_types_row(true, -1));
  const std::string ascii =
      write("ascii.ply", std::string("ply\r\nformat ascii 1.0\r\n") + kAllTypes +
                             "100 200 30000 60000 16777216 2147483648 0.1 0.25\r\n"
                             "-100 200 -30000 60000 -16777216 2147483648 1e-1 -.25");
  for (const std::string& file : {little, big, ascii}) {
    EXPECT_EQ(read_column(file, "a"), (std::vector<float>{100, -100}));
    EXPECT_EQ(read_column(file, "b"), (std::vector<float>{200, 200}));
    EXPECT_EQ(read_column(file, "c"), (std::vector<float>{30000, -30000}));
    EXPECT_EQ(read_column(file, "d"), (std::vector<float>{60000, 60000}));
    EXPECT_EQ(read_column(file, "e"), (std::vector<float>{16777216, -16777216}));
    EXPECT_EQ(read_column(file, "f"), (std::vector<float>{2147483648.0F, 2147483648.0F}));
    EXPECT_EQ(read_column(file, "g"), (std::vector<float>{0.1F, 0.1F}));
    EXPECT_EQ(read_column(file, "h"), (std::vector<float>{0.25F, -0.25F}));
  }
}

TEST_F(PlyTest, AsciiSpecialNumbers) {
  const std::string file = write("a.ply", test::ply_header("ascii", {}, 6, {"x"}) +
                                              "nan\ninf\n-inf\n+2.5\n1e-50\n3.4028235e38\n");
  const std::vector<float> x = read_column(file, "x");
  EXPECT_TRUE(std::isnan(x[0]));
  EXPECT_EQ(x[1], std::numeric_limits<float>::infinity());
  EXPECT_EQ(x[2], -std::numeric_limits<float>::infinity());
  EXPECT_EQ(x[3], 2.5F);
  EXPECT_EQ(x[4], 0.0F);
  EXPECT_EQ(x[5], std::numeric_limits<float>::max());
}

TEST_F(PlyTest, Float32BitsSurvive) {
  std::string file = test::ply_header("binary_little_endian", {}, 3, {"x"});
  for (const uint32_t bits : {0x7fc12345U, 0x80000000U, 0x00000001U}) test::append(file, bits);
  const std::vector<float> x = read_column(write("a.ply", file), "x");
  for (size_t i = 0; i < 3; ++i) {
    uint32_t bits = 0;
    std::memcpy(&bits, &x[i], 4);
    EXPECT_EQ(bits, (std::vector<uint32_t>{0x7fc12345U, 0x80000000U, 0x00000001U})[i]);
  }
}

TEST_F(PlyTest, ElementsBeforeAreSkippedWithTheirLists) {
  const std::string head =
      "element camera 2\nproperty list uchar short ids\nproperty double f\n"
      "element pair 1\nproperty int p\nelement vertex 1\nproperty float x\n"
      "element face 1000000\nproperty list uchar int vertex_indices\nend_header\n";
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + head;
  for (const int n : {3, 0}) {
    test::append<uint8_t>(binary, static_cast<uint8_t>(n));
    for (int i = 0; i < n; ++i) test::append<int16_t>(binary, 7);
    test::append<double>(binary, 1.5);
  }
  test::append<int32_t>(binary, 9);
  test::append<float>(binary, 42.5F);
  EXPECT_EQ(read_column(write("b.ply", binary), "x"), std::vector<float>{42.5F});
  const std::string ascii =
      "ply\nformat ascii 1.0\n" + head + "3 7 7 7 1.5\n0 1.5\n9\n42.5\n3 0 0 0\n";
  EXPECT_EQ(read_column(write("a.ply", ascii), "x"), std::vector<float>{42.5F});
}

TEST_F(PlyTest, CommentsByKey) {
  const std::string file =
      write("a.ply",
            "ply\nformat ascii 1.0\ncomment fpsx 1\ncomment  fps   25 \ncomment bare\n"
            "obj_info anything\nelement vertex 0\nproperty float x\nend_header\n");
  PlyReader reader(InputFile(file), "vertex");
  EXPECT_STREQ(reader.header().comment("fps"), "25");
  EXPECT_STREQ(reader.header().comment("bare"), "");
  EXPECT_EQ(reader.header().comment("fp"), nullptr);
}

TEST_F(PlyTest, WriterAndReaderAgree) {
  PlyWriter writer(path("w.ply"), {"hello 1"}, 5000, {"a", "b", "c"});
  for (int i = 0; i < 5000; ++i) {
    float* row = writer.next_row();
    for (int k = 0; k < 3; ++k) row[k] = static_cast<float>(i * 3 + k);
  }
  EXPECT_FALSE(std::filesystem::exists(path("w.ply")));  // appears when it is complete
  writer.finish();
  const std::vector<float> b = read_column(path("w.ply"), "b");
  ASSERT_EQ(b.size(), 5000U);
  for (size_t i = 0; i < b.size(); ++i) ASSERT_EQ(b[i], static_cast<float>(i * 3 + 1));
  EXPECT_EQ(files_in_directory(), 1U);
}

TEST_F(PlyTest, AbandonedWriterLeavesNothing) {
  write("w.ply", "old");
  {
    PlyWriter writer(path("w.ply"), {}, 10, {"a"});
    *writer.next_row() = 1;
  }
  EXPECT_EQ(test::read_bytes(path("w.ply")), "old");
  EXPECT_EQ(files_in_directory(), 1U);
}

TEST_F(PlyTest, OutputReplacesTheTargetOfALink) {
  write("real.bin", "old");
  std::filesystem::create_symlink(path("real.bin"), path("link.bin"));
  OutputFile file(path("link.bin"));
  file.write("new", 3);
  file.commit();
  EXPECT_TRUE(std::filesystem::is_symlink(path("link.bin")));
  EXPECT_EQ(test::read_bytes(path("real.bin")), "new");
}

TEST_F(PlyTest, FileErrorsAreIoErrors) {
  EXPECT_EQ(test::status_of([&] { InputFile file(path("absent")); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { InputFile file(path("")); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { OutputFile file(path("no/such/directory")); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { OutputFile file(path("")); }), L4D_ERR_IO);
  const std::vector<uint8_t> bytes = read_whole_file(write("three", "abc"));
  EXPECT_EQ(bytes, (std::vector<uint8_t>{'a', 'b', 'c'}));
}

// ---- hostile input ----

l4d_status read_status(const std::string& bytes, std::string* message = nullptr) {
  return test::status_of(
      [&] {
        PlyReader reader(test::in_memory(bytes), "vertex");
        std::vector<float> x(static_cast<size_t>(reader.element().count) *
                             reader.element().properties.size());
        std::vector<PlyColumn> columns(reader.element().properties.size());
        for (size_t p = 0; p < columns.size(); ++p) {
          columns[p].property = p;
          columns[p].to_float = x.data() + p;
          columns[p].stride = columns.size();
        }
        reader.read_rows(columns);
      },
      message);
}

TEST_F(PlyTest, EveryTruncationIsRefused) {
  const std::string little = std::string("ply\nformat binary_little_endian 1.0\ncomment c\n") +
                             kAllTypes + all_types_row(false, 1) + all_types_row(false, -1);
  const std::string ascii =
      std::string("ply\nformat ascii 1.0\n") + kAllTypes + "1 2 3 4 5 6 7 8\n1 2 3 4 5 6 7 8";
  const std::string lists =
      "ply\nformat binary_big_endian 1.0\nelement f 2\nproperty list uchar int i\n"
      "element vertex 1\nproperty uchar x\nend_header\n" +
      std::string("\1\0\0\0\0\1\0\0\0\0\7", 11);
  for (const std::string& whole : {little, ascii, lists}) {
    EXPECT_EQ(read_status(whole), L4D_OK);
    for (size_t size = 0; size < whole.size(); ++size) {
      ASSERT_EQ(read_status(whole.substr(0, size)), L4D_ERR_CORRUPT) << size;
    }
  }
}

TEST_F(PlyTest, EveryChangedByteReadsOrFailsCleanly) {
  const std::string whole =
      "ply\nformat ascii 1.0\nelement f 1\nproperty list uchar int i\nelement vertex 2\n"
      "property float x\nproperty int y\nend_header\n2 5 6\n1.5 3\n2.5 4\n";
  std::string binary = whole.substr(0, whole.find("end_header") + 11);
  binary.replace(binary.find("ascii"), 5, "binary_little_endian");
  binary += std::string("\2", 1) + std::string(8 + 16, '\1');
  for (const std::string& base : {whole, binary}) {
    ASSERT_EQ(read_status(base), L4D_OK);
    for (size_t i = 0; i < base.size(); ++i) {
      for (const char c : {'\0', '\n', ' ', '9', '-', 'e', '\xff'}) {
        std::string mutant = base;
        mutant[i] = c;
        const l4d_status status = read_status(mutant);
        ASSERT_TRUE(status == L4D_OK || status == L4D_ERR_CORRUPT ||
                    status == L4D_ERR_FEATURE_UNSUPPORTED)
            << i << " " << status;
      }
    }
  }
}

TEST_F(PlyTest, RowsOfTextHaveALineEach) {
  const std::string head =
      "ply\nformat ascii 1.0\nelement f 1\nproperty list uchar int i\nelement vertex 2\n"
      "property float x\nproperty int y\nend_header\n";
  EXPECT_EQ(read_status(head + "2 5 6\n\n1.5 3\n\n2.5 4"), L4D_OK);
  const struct {
    const char *rows, *message;
  } cases[] = {{"2 5 6\n1.5 3 9\n2.5 4 9\n", "line 10, element vertex, row 1: the row before"},
               {"2 5 6\n1.5\n3 2.5 4\n", "line 10, element vertex, row 0: fewer"},
               {"2 5 6 1.5 3\n2.5 4\n", "line 9, element vertex, row 0: the row before"},
               {"2 5\n6\n1.5 3\n2.5 4\n", "line 9, element f, row 0: fewer"}};
  for (const auto& c : cases) {
    std::string message;
    EXPECT_EQ(read_status(head + c.rows, &message), L4D_ERR_CORRUPT) << c.rows;
    EXPECT_NE(message.find(c.message), std::string::npos) << message;
  }
}

TEST_F(PlyTest, WhatFollowsTheRowsIsRefused) {
  const std::string ascii =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement f 1\n"
      "property list uchar int i\nend_header\n1\n";
  std::string binary = test::replaced(ascii, "ascii", "binary_little_endian");
  binary = binary.substr(0, binary.size() - 2) + std::string("\0\0\0\0\1", 5);
  const auto finished = [&](const std::string& text) {
    return test::status_of([&] {
      PlyReader reader(InputFile(write("end.ply", text)), "vertex");
      reader.read_rows({});
      reader.finish();
    });
  };
  EXPECT_EQ(finished(ascii + "2 5 6\n \r\n"), L4D_OK);
  EXPECT_EQ(finished(ascii + "2 5\n"), L4D_ERR_CORRUPT);
  EXPECT_EQ(finished(ascii + "2 5 6\n7\n"), L4D_ERR_CORRUPT);
  EXPECT_EQ(finished(binary + std::string(4, 0)), L4D_OK);
  EXPECT_EQ(finished(binary + std::string(4, 0) + "\n"), L4D_OK);
  EXPECT_EQ(finished(binary + std::string(3, 0)), L4D_ERR_CORRUPT);
  EXPECT_EQ(finished(binary + std::string(5, 0)), L4D_ERR_CORRUPT);
}

TEST_F(PlyTest, AbsurdCountsAreRefusedBeforeAllocation) {
  for (const char* count : {"4294967296", "9223372036854775807", "18446744073709551615", "1000"}) {
    for (const char* format : {"ascii", "binary_little_endian"}) {
      const std::string file = std::string("ply\nformat ") + format + " 1.0\nelement vertex " +
                               count + "\nproperty float x\nproperty double y\nend_header\n1 2\n";
      std::string message;
      EXPECT_EQ(read_status(file, &message), L4D_ERR_CORRUPT) << count;
      EXPECT_NE(message.find("bytes are left"), std::string::npos) << message;
    }
  }
}

TEST_F(PlyTest, BadHeadersNameTheirLine) {
  const struct {
    const char* header;
    const char* expected;
  } kCases[] = {
      {"", "the file is empty"},
      {"plx\n", "not a PLY"},
      {"\x89PNG\r\n\x1a\n", "not a PLY"},
      {"ply\nformat ascii 1.0\nelement ver", "the file ends in its header, in line 3"},
      {"ply\nformat ascii 2.0\n", "line 2"},
      {"ply\nformat utf8 1.0\n", "line 2"},
      {"ply\n\n", "line 2 is empty"},
      {"ply\nformat ascii 1.0\nformat ascii 1.0\n", "line 3"},
      {"ply\nformat ascii 1.0\nelement vertex -1\n", "line 3"},
      {"ply\nformat ascii 1.0\nelement vertex 1e3\n", "line 3"},
      {"ply\nformat ascii 1.0\nelement vertex 18446744073709551616\n", "line 3"},
      {"ply\nformat ascii 1.0\nelement vertex\n", "line 3"},
      {"ply\nformat ascii 1.0\nproperty float x\n", "line 3"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n", "line 4"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float\n", "line 4"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int x\n", "line 4"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nelement vertex 1\n", "line 4"},
      {"ply\nformat ascii 1.0\nvertex 1\n", "line 3"},
      {"ply\nelement vertex 0\nproperty float x\nend_header\n", "no format line"},
      {"ply\nformat ascii 1.0\nend_header\n", "no element vertex"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", "no properties"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int x\nend_header\n1 1\n",
       "declared twice"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty uchar x\nend_header\n256\n",
       "value of x"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1.5q\n", "row 0"},
      {"ply\nformat ascii 1.0\nelement f 1\nproperty list int int x\nelement vertex 1\n"
       "property float x\nend_header\n-5\n1\n",
       "list length"},
  };
  for (const auto& c : kCases) {
    std::string message;
    EXPECT_EQ(read_status(c.header, &message), L4D_ERR_CORRUPT) << c.header;
    EXPECT_NE(message.find(c.expected), std::string::npos) << c.header << "\n" << message;
  }
}

TEST_F(PlyTest, EndlessHeaderAndManyPropertiesAreRefused) {
  EXPECT_EQ(read_status("ply\ncomment " + std::string(3 << 20, 'x')), L4D_ERR_CORRUPT);
  std::string many = "ply\nformat ascii 1.0\nelement vertex 1\n";
  for (int i = 0; i < 5000; ++i) many += "property float p" + std::to_string(i) + "\n";
  std::string message;
  EXPECT_EQ(read_status(many + "end_header\n", &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("too many properties"), std::string::npos);
}

TEST_F(PlyTest, ListsOfTheElementItselfAreUnsupported) {
  EXPECT_EQ(read_status("ply\nformat ascii 1.0\nelement vertex 1\n"
                        "property list uchar int x\nend_header\n1 1\n"),
            L4D_ERR_FEATURE_UNSUPPORTED);
}

}  // namespace
}  // namespace l4d::io
