// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/shard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "evaluation/charts/row_file.h"
#include "evaluation/files/error.h"
#include "tests/support/program.h"

namespace forcegrid::evaluation {
namespace {

using forcegrid::testing::fresh_folder;
using forcegrid::testing::text_of;
using ::testing::HasSubstr;

TEST(Shard, EachPieceIsInOneOfThem) {
  for (const std::size_t count : {1U, 2U, 3U, 7U, 50U}) {
    for (const std::size_t pieces : {1U, 2U, 10U, 49U, 1000U}) {
      for (std::size_t piece = 0; piece < pieces; ++piece) {
        int owners = 0;
        for (std::size_t number = 1; number <= count; ++number) {
          owners += Shard{number, count}.has(piece, pieces) ? 1 : 0;
        }
        ASSERT_EQ(owners, 1) << piece << " of " << pieces << ", " << count << " shards";
      }
    }
  }
}

TEST(Shard, IsReadAndRefused) {
  const Shard second = parse_shard("2/8");
  EXPECT_EQ(second.number, 2U);
  EXPECT_EQ(second.count, 8U);
  EXPECT_TRUE(parse_shard("1/1").whole());
  for (const char* const wrong : {"", "2", "0/8", "9/8", "-1/8", "1/0", "a/b", "1/2/3", "1/2 ",
                                  "1/100001", "1/99999999999999999999"}) {
    try {
      static_cast<void>(parse_shard(wrong));
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), HasSubstr("2/8"));
    }
  }
}

std::string row(const char* key, const char* program) {
  return nlohmann::ordered_json{{"key", key}, {"value", 1}, {"program", program}}.dump() + "\n";
}

std::filesystem::path shard_with(const std::string& name, const std::string& rows) {
  const std::filesystem::path folder = fresh_folder(name);
  std::ofstream(folder / "rows.jsonl") << rows;
  return folder;
}

TEST(MergeRows, TakesEachRowOnceAndLeavesTheShardsAlone) {
  const std::filesystem::path all = fresh_folder("merge_all");
  const std::string torn = row("b", "p") + "{\"key\": \"c\", \"va";
  const auto first = shard_with("merge_first", row("a", "p"));
  const auto second = shard_with("merge_second", row("a", "p") + torn);
  EXPECT_EQ(merge_rows(all, "p", {first, second}), 2U);
  EXPECT_EQ(merge_rows(all, "p", {first, second}), 0U) << "they are there";
  EXPECT_EQ(text_of((all / "rows.jsonl").string()), row("a", "p") + row("b", "p"));
  EXPECT_EQ(text_of((second / "rows.jsonl").string()), row("a", "p") + torn);
}

TEST(MergeRows, RefusesWhatIsNoShardAndRowsOfAnotherProgram) {
  const std::filesystem::path all = fresh_folder("merge_refused");
  const auto other = shard_with("merge_other", row("a", "q"));
  try {
    merge_rows(all, "p", {other});
    ADD_FAILURE();
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("another program"));
  }
  try {
    merge_rows(all, "p", {all / "nothing"});
    ADD_FAILURE();
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("nothing/rows.jsonl"));
  }
}

}  // namespace
}  // namespace forcegrid::evaluation
