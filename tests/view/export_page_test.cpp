// SPDX-License-Identifier: Apache-2.0
// What an exported page holds, and how it is written.

#include "view/export_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sodium.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "view/export_record.h"
#include "view/options.h"
#include "view_link/little_endian.h"
#include "view_link/surface_messages.h"

namespace forcegrid::view {
namespace {

using nlohmann::json;
using view_link::Bytes;
using view_link::FeedType;
using view_link::Frame;

constexpr std::int64_t kFirst_ns = 5'000'000'000;

struct Message {
  double time_s;
  bool is_text;
  std::uint32_t tool;
  Bytes bytes;
};

// The messages of a packed record, read by the format alone.
std::vector<Message> unpacked(const Bytes& packed) {
  std::vector<Message> found;
  EXPECT_EQ(std::memcmp(packed.data(), "FGX1", 4), 0);
  for (std::size_t at = 4; at < packed.size();) {
    Message message;
    std::uint32_t size = 0;
    std::uint32_t kind = 0;
    std::memcpy(&message.time_s, packed.data() + at, 8);
    std::memcpy(&size, packed.data() + at + 8, 4);
    std::memcpy(&kind, packed.data() + at + 12, 4);
    message.is_text = kind % 256 == 1;
    message.tool = kind / 256;
    const auto begin = packed.begin() + static_cast<std::ptrdiff_t>(at + 16);
    message.bytes.assign(begin, begin + size);
    found.push_back(message);
    at += 16 + size;
  }
  return found;
}

Frame text(FeedType type, const json& content) {
  return view_link::text_frame(static_cast<std::uint16_t>(type), content.dump());
}

Frame hello(std::uint64_t surface_frames, std::size_t tools = 1) {
  return text(FeedType::kHello, {{"methods", {"hold"}},
                                 {"largest_force_N", 5},
                                 {"simulator_rate_Hz", 30},
                                 {"recording",
                                  {{"first_ns", kFirst_ns},
                                   {"duration_s", 2.0},
                                   {"tools", tools},
                                   {"surface_frames", surface_frames}}},
                                 {"copies",
                                  {{"low_W_m", {-0.1, -0.1, -0.1}},
                                   {"high_W_m", {0.1, 0.1, 0.1}},
                                   {"cells", {20, 20, 20}},
                                   {"influence_radius_m", 0.03},
                                   {"unit_m", 0.001},
                                   {"samples_per_cell", 0},
                                   {"budget_reads", nullptr},
                                   {"fill_budget", 1000},
                                   {"requests_per_s", 0}}}});
}

// A recording of so many seconds at 500 Hz, with a picture of the surface every 32 ms.
void feed(ExportRecord& record, double length_s) {
  const view_link::SurfaceShape shape{3, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
  const auto cycles = static_cast<std::uint64_t>(500 * length_s);
  const std::uint64_t pictures = (cycles + 15) / 16;
  record.take_feed(1, hello(1 + pictures));
  record.take_surface(1, encode(shape));
  for (std::uint64_t i = 0; i < cycles; ++i) {
    view_link::FeedCycle cycle;
    cycle.cycle = i;
    cycle.time_ns = kFirst_ns + static_cast<std::int64_t>(i) * 2'000'000;
    Frame frame{static_cast<std::uint16_t>(FeedType::kCycles), 0, {}};
    view_link::append(frame.payload, cycle);
    record.take_feed(1, frame);
    if (i % 16 == 0) {
      const double time_s = 0.002 * static_cast<double>(i);
      record.take_surface(
          1, encode(view_link::SurfaceFrame{3, time_s, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0.5F}}}));
      record.take_feed(1, {static_cast<std::uint16_t>(FeedType::kArm), 0, {0, 0, 0, 0}});
    }
  }
  record.take_feed(1, text(FeedType::kEnd, {{"text", ""}}));
}

TEST(ExportRecord, HoldsWhatAPageWouldBeToldWithItsTimes) {
  ExportRecord record(std::size_t{50} << 20);
  feed(record, 2.0);
  EXPECT_TRUE(record.complete());
  EXPECT_EQ(record.left_out(), "");
  const auto messages = unpacked(record.pack(""));
  std::map<int, int> kinds;
  double newest_s = 0.0;
  for (const Message& message : messages) {
    EXPECT_GE(message.time_s, newest_s) << "in order";
    newest_s = message.time_s;
    ++kinds[message.is_text ? 0 : message.bytes.at(0)];
    if (!message.is_text && message.bytes[0] == 3) {
      double time_s = 0.0;
      std::memcpy(&time_s, message.bytes.data() + 16, sizeof(time_s));
      EXPECT_EQ(message.time_s, time_s) << "the surface's own";
    }
  }
  EXPECT_EQ(kinds[0], 1) << "the hello";
  EXPECT_EQ(kinds[1], 200) << "a row every 10 ms, the last with the end";
  EXPECT_EQ(kinds[2], 1);
  EXPECT_EQ(kinds[3], 63);
  EXPECT_EQ(kinds[5], 63);
  EXPECT_EQ(kinds[6], 10 + 2 * 4) << "five slices a second across y, two across x and z";
  EXPECT_NEAR(newest_s, 1.998, 1e-6);
}

TEST(ExportRecord, WaitsForEveryPictureOfTheSurface) {
  ExportRecord record(1 << 20);
  record.take_feed(1, hello(1));
  record.take_feed(1, text(FeedType::kEnd, {{"text", ""}}));
  EXPECT_FALSE(record.complete());
  EXPECT_EQ(record.surfaces_missing(), 1U);
  record.take_surface(1, encode(view_link::SurfaceShape{3, {{0, 0, 0}}, {}}));
  EXPECT_TRUE(record.complete());
}

TEST(ExportRecord, HoldsTheRecordingsOfSeveralTools) {
  ExportRecord record(std::size_t{50} << 20);
  const Frame end = text(FeedType::kEnd, {{"text", ""}});
  for (std::uint16_t tool = 0; tool < 2; ++tool) {
    Frame begin = hello(0, 2);
    begin.object = tool;
    record.take_feed(10 + tool, begin);
  }
  for (std::int64_t i = 0; i < 500; ++i) {  // a second; the right tool begins half a second later
    view_link::FeedCycle cycle;
    cycle.time_ns = kFirst_ns + i * 2'000'000;
    for (std::uint16_t tool = 0; tool < 2; ++tool) {
      cycle.position_W_m = {0.25 * tool, 0.0, 0.0};
      Frame frame{static_cast<std::uint16_t>(FeedType::kCycles), 0, {}};
      view_link::append(frame.payload, cycle);
      if (tool == 0 || i >= 250) {
        record.take_feed(10 + tool, frame);
      }
    }
  }
  record.take_feed(10, {static_cast<std::uint16_t>(FeedType::kArm), 0, {0, 0, 0, 0}});
  record.take_feed(10, end);
  EXPECT_FALSE(record.complete()) << "the other one goes on";
  record.take_feed(11, end);
  EXPECT_TRUE(record.complete());
  std::map<int, std::array<int, 2>> kinds;
  for (const Message& message : unpacked(record.pack(""))) {
    ASSERT_LT(message.tool, 2U);
    ++kinds[message.is_text ? 0 : message.bytes.at(0)][message.tool];
    if (!message.is_text && (message.bytes[0] == 5 || message.bytes[0] == 10)) {
      EXPECT_EQ(message.bytes[1], message.tool);
    }
    if (!message.is_text && message.bytes[0] == 10) {
      float x_m = -1.0F;
      std::memcpy(&x_m, message.bytes.data() + 4, 4);
      EXPECT_EQ(x_m, 0.25F * static_cast<float>(message.tool));
    }
    EXPECT_GE(message.time_s, message.is_text || message.tool == 0 ? 0.0 : 0.5);
  }
  using Both = std::array<int, 2>;
  EXPECT_EQ(kinds[0], (Both{1, 1})) << "a hello of each";
  EXPECT_EQ(kinds[1], (Both{100, 50})) << "a row every 10 ms";
  EXPECT_EQ(kinds[5], (Both{1, 0}));
  EXPECT_EQ(kinds[6], (Both{5 + 2 * 2, 3 + 2 * 1})) << "slices";
  EXPECT_EQ(kinds[10], (Both{63, 32})) << "a place every 16 ms";
}

TEST(ExportRecord, SaysWhatItLeavesOut) {
  constexpr std::size_t kMost = 1'200'000;  // a slice has 22 kB: 72 of them are too many
  ExportRecord record(kMost);
  feed(record, 8.0);
  EXPECT_EQ(record.left_out(), "every 2nd slice of the field");
  const auto field = record.kept(ExportKind::kField);
  EXPECT_EQ(field.all, 40U + 2 * 16);
  EXPECT_EQ(field.kept, 36U) << "of each axis the first, the third, ...";
  EXPECT_EQ(record.kept(ExportKind::kSurface).kept, 250U);
  std::size_t bytes = 0;
  const auto messages = unpacked(record.pack("It has only some."));
  for (const Message& message : messages) {
    bytes += message.bytes.size();
  }
  EXPECT_LT(bytes, kMost);
  EXPECT_EQ(std::count_if(messages.begin(), messages.end(),
                          [](const Message& message) {
                            return message.is_text &&
                                   json::parse(message.bytes).value("text", "") ==
                                       "It has only some.";
                          }),
            1);
}

class ExportedPage : public testing::Test {
 protected:
  static const PageFiles& files() {
    static const PageFiles read = load_page_files(default_page_folders());
    return read;
  }
  std::string folder_ = testing::TempDir() + "export_page_" + std::to_string(getpid());
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
};

TEST_F(ExportedPage, HasNothingThatABrowserWouldFetch) {
  const std::string page = page_with(files(), "AAAA");
  const std::size_t map = page.find("<script type=\"importmap\">");
  ASSERT_NE(map, std::string::npos);
  const std::string end = "</script>";
  const json imports =
      json::parse(page.substr(map + 25, page.find(end, map) - map - 25)).at("imports");
  EXPECT_GE(imports.size(), 15U);
  for (const auto& [name, address] : imports.items()) {
    const std::string script = address;
    const std::string before = "data:text/javascript;base64,";
    ASSERT_EQ(script.rfind(before, 0), 0U) << name;
    std::string text(script.size(), '\0');
    std::size_t length = 0;
    ASSERT_EQ(sodium_base642bin(reinterpret_cast<unsigned char*>(text.data()), text.size(),
                                script.data() + before.size(), script.size() - before.size(),
                                nullptr, &length, nullptr, sodium_base64_VARIANT_ORIGINAL),
              0);
    text.resize(length);
    // Every module that a module names is in the map.
    const std::string from = "from '";
    EXPECT_EQ(text.find(from + "/"), std::string::npos) << name;
    for (std::size_t at = 0; (at = text.find(from + "forcegrid/", at)) != std::string::npos; ++at) {
      const std::size_t begin = at + from.size();
      const std::string needed = text.substr(begin, text.find('\'', begin) - begin);
      EXPECT_TRUE(imports.contains(needed)) << name << " needs " << needed;
    }
  }
  const std::string head = page.substr(0, page.find("<style>"));
  EXPECT_THAT(head, testing::HasSubstr("default-src 'none'"));
  EXPECT_EQ(page.find("href=\"/"), std::string::npos);
  EXPECT_EQ(page.find("src=\"/"), std::string::npos);
}

TEST_F(ExportedPage, HoldsTheRecordCompressed) {
  ExportRecord record(std::size_t{50} << 20);
  feed(record, 0.5);
  const std::string page = exported_page(files(), record, 20'000'000);
  const std::string begin = "<script id=\"exported\" type=\"application/octet-stream\">";
  const std::size_t from = page.find(begin) + begin.size();
  const std::string text = page.substr(from, page.find("</script>", from) - from);
  std::string packed(text.size(), '\0');
  std::size_t length = 0;
  ASSERT_EQ(
      sodium_base642bin(reinterpret_cast<unsigned char*>(packed.data()), packed.size(), text.data(),
                        text.size(), nullptr, &length, nullptr, sodium_base64_VARIANT_ORIGINAL),
      0);
  const Bytes expected = record.pack("");
  Bytes plain(expected.size() + 1);
  z_stream stream{};
  ASSERT_EQ(inflateInit2(&stream, 15 + 16), Z_OK);
  stream.next_in = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_in = static_cast<uInt>(length);
  stream.next_out = plain.data();
  stream.avail_out = static_cast<uInt>(plain.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  inflateEnd(&stream);
  plain.resize(stream.total_out);
  EXPECT_EQ(plain, expected);
}

TEST_F(ExportedPage, IsThinnedUntilItFitsOrRefused) {
  const std::size_t empty = page_with(files(), "").size();
  ExportRecord record(std::size_t{50} << 20);
  feed(record, 4.0);
  const std::size_t whole = exported_page(files(), record, 20'000'000).size();
  const std::size_t limit = empty + (whole - empty) / 2;
  EXPECT_LE(exported_page(files(), record, limit).size(), limit);
  EXPECT_NE(record.left_out(), "");
  try {
    exported_page(files(), record, empty);
    ADD_FAILURE() << "it fits";
  } catch (const ViewError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("--export-MB"));
  }
}

TEST_F(ExportedPage, IsWrittenAsAWholeOrNotAtAll) {
  const std::string file = folder_ + "/page.html";
  check_export(file);
  EXPECT_FALSE(std::filesystem::exists(file));
  write_export(file, "first");
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string refusal;
  try {
    write_export(file, std::string(5000, 'x'));  // a disk without room
  } catch (const ViewError& error) {
    refusal = error.what();
  }
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(refusal, testing::AllOf(testing::HasSubstr(file), testing::HasSubstr("too large")));
  std::ifstream stream(file);
  std::stringstream content;
  content << stream.rdbuf();
  EXPECT_EQ(content.str(), "first");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1) << "no remains";
}

TEST_F(ExportedPage, IsRefusedBeforeThereIsAnythingToWrite) {
  for (const std::string& file : {folder_, folder_ + "/none/page.html", std::string("/dev/full")}) {
    EXPECT_THROW(check_export(file), ViewError) << file;
  }
}

}  // namespace
}  // namespace forcegrid::view
