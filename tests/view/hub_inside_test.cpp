// SPDX-License-Identifier: Apache-2.0
// What is inside of the objects goes to the pages that show it, while they do.
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "tests/view/hub_pages.h"
#include "view_link/inside_messages.h"

namespace forcegrid::view {
namespace {

using view_link::InsideLines;

constexpr const char* kShow = R"({"what":"layers","blocks":false,"inside":true})";
constexpr const char* kHide = R"({"what":"layers","blocks":false,"inside":false})";

InsideLines lines(std::uint32_t epoch) { return {epoch, 3, 2, 0, {{0, 1}, {1, 2}}}; }

Frame inside_frame(std::uint32_t epoch) {
  return view_link::encode_inside({epoch, 1.0, {{0, 0, 0}, {1, 0, 0}, {0, 1, 1}}});
}

class HubOfInsides : public testing::Test {
 protected:
  // The types of the binary messages that wait for a page.
  static std::vector<int> binary(Page& page) {
    page.binary.clear();
    page.texts();
    std::vector<int> types;
    for (const view_link::Bytes& each : page.binary) {
      types.push_back(each[0]);
    }
    return types;
  }

  using Told = std::vector<std::pair<std::uint64_t, bool>>;
  Told told_;  // which simulators, and what
  Hub hub_{[](const Frame&, PageCommand::What, bool) { return true; },
           [this](std::uint64_t peer, const Frame& wish) {
             told_.emplace_back(peer, view_link::decode_wish(wish.payload).value());
           }};
  Page first_, second_;
};

TEST_F(HubOfInsides, TellSimulatorsWhenTheFirstPageWishesItAndWhenTheLastDoesNoMore) {
  hub_.join(first_);
  hub_.join(second_);
  hub_.take_surface(1, encode(shape(5), 0));
  hub_.take_surface(2, encode(shape(5), 1));
  EXPECT_EQ(told_, Told{}) << "nobody wishes anything";
  hub_.take_page(first_, kShow);
  EXPECT_EQ(told_, (Told{{1, true}, {2, true}}));
  hub_.take_page(second_, kShow);
  hub_.take_page(first_, kHide);
  EXPECT_EQ(told_.size(), 2U) << "the second page shows it still";
  hub_.leave(second_);
  EXPECT_EQ(told_, (Told{{1, true}, {2, true}, {1, false}, {2, false}}));
}

TEST_F(HubOfInsides, TellASimulatorThatComesLaterWithItsFirstShape) {
  hub_.join(first_);
  hub_.take_page(first_, kShow);
  hub_.take_surface(7, encode(shape(5), 0));
  EXPECT_EQ(told_, (Told{{7, true}}));
  hub_.take_surface(7, encode(shape(6), 0));
  hub_.take_surface(7, encode(shape(1), 1));
  EXPECT_EQ(told_.size(), 1U) << "it knows";
  hub_.surface_lost(7);
  hub_.take_surface(7, encode(shape(5), 0));
  EXPECT_EQ(told_.size(), 2U) << "it is another one";
}

TEST_F(HubOfInsides, GoToThePagesThatShowThem) {
  hub_.join(first_);
  hub_.join(second_);
  hub_.take_page(first_, kShow);
  hub_.take_surface(1, encode(shape(5)));
  binary(first_);
  binary(second_);
  const Frame sent = encode(lines(1));
  hub_.take_surface(1, sent);
  hub_.take_surface(1, inside_frame(1));
  EXPECT_EQ(binary(first_), (std::vector<int>{8, 9}));
  EXPECT_EQ(first_.binary[0].size(), 4 + sent.payload.size());
  EXPECT_TRUE(std::equal(sent.payload.begin(), sent.payload.end(), first_.binary[0].begin() + 4));
  EXPECT_EQ(binary(second_), (std::vector<int>{}));
  hub_.take_page(second_, kShow);
  EXPECT_EQ(binary(second_), (std::vector<int>{8, 9})) << "what came before";
  hub_.take_surface(1, inside_frame(1));
  hub_.take_page(first_, kHide);
  EXPECT_EQ(binary(first_), (std::vector<int>{})) << "not what waits, either";
  EXPECT_EQ(binary(second_), (std::vector<int>{9}));
}

TEST_F(HubOfInsides, EndWithTheShapeOfAnotherEpoch) {
  hub_.join(first_);
  hub_.take_page(first_, kShow);
  hub_.take_surface(1, encode(shape(5)));
  hub_.take_surface(1, encode(lines(1)));
  hub_.take_surface(1, inside_frame(1));
  hub_.take_surface(1, encode(shape(6)));
  EXPECT_EQ(binary(first_), (std::vector<int>{2})) << "the lines that waited were of another shape";
  hub_.take_surface(1, inside_frame(1));
  EXPECT_EQ(binary(first_), (std::vector<int>{})) << "no lines for it";
  hub_.take_surface(1, encode(lines(2)));
  hub_.take_surface(1, inside_frame(1));
  hub_.take_surface(1, inside_frame(2));
  EXPECT_EQ(binary(first_), (std::vector<int>{8, 9}));
}

TEST_F(HubOfInsides, AreNotShownOldWhenTheyAreWishedAgain) {
  hub_.join(first_);
  hub_.take_page(first_, kShow);
  hub_.take_surface(1, encode(shape(5)));
  hub_.take_surface(1, encode(lines(1)));
  hub_.take_surface(1, inside_frame(1));
  hub_.take_page(first_, kHide);
  binary(first_);
  hub_.take_page(first_, kShow);
  EXPECT_EQ(binary(first_), (std::vector<int>{8})) << "a frame of long ago";
  // The simulator did not see that nobody wished it for a moment.
  hub_.take_surface(1, inside_frame(1));
  EXPECT_EQ(binary(first_), (std::vector<int>{9}));
}

TEST_F(HubOfInsides, AreCheckedWhetherAPageShowsThemOrNot) {
  EXPECT_THROW(hub_.take_surface(1, encode(lines(1))), ViewLinkError) << "before the shape";
  EXPECT_THROW(hub_.take_surface(1, inside_frame(1)), ViewLinkError);
  hub_.take_surface(1, encode(shape(5)));
  EXPECT_THROW(hub_.take_surface(2, encode(lines(1))), ViewLinkError) << "another one's object";
  EXPECT_THROW(hub_.take_surface(1, {4, 0, {}}), ViewLinkError);
  Frame one_too_many = encode(lines(1));
  one_too_many.payload.push_back(0);
  EXPECT_THROW(hub_.take_surface(1, one_too_many), ViewLinkError);
  hub_.take_surface(1, encode(lines(1)));
  EXPECT_THROW(hub_.take_surface(1, view_link::encode_inside({1, 1.0, {{0, 0, 0}}})),
               ViewLinkError);
  EXPECT_THROW(hub_.take_surface(1, {5, 0, view_link::Bytes(43)}), ViewLinkError);
}

TEST_F(HubOfInsides, MayBeAskedOfARunAndNotOfARecording) {
  hub_.join(first_);
  first_.texts();
  hub_.take_feed(hello());
  EXPECT_EQ(first_.texts().at(0)["inside"], true);
  hub_.take_feed(text(FeedType::kEnd, "{}"));
  first_.texts();
  hub_.take_feed(text(FeedType::kHello, R"({"methods":["auto"],"recording":{"first_ns":0}})"));
  EXPECT_EQ(first_.texts().at(0)["inside"], false);
}

TEST_F(HubOfInsides, AreNotTouchedByAPageThatDoesNotKnowThem) {
  hub_.join(first_);
  hub_.take_surface(1, encode(shape(5)));
  hub_.take_page(first_, R"({"what":"layers","blocks":false})");
  EXPECT_EQ(told_, Told{});
  for (const char* bad :
       {R"({"what":"layers","inside":true})", R"({"what":"layers","blocks":false,"inside":1})"}) {
    EXPECT_THROW(hub_.take_page(first_, bad), ViewLinkError) << bad;
  }
}

}  // namespace
}  // namespace forcegrid::view
