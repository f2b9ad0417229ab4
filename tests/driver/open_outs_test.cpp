// SPDX-License-Identifier: Apache-2.0
// Which OUT a report answers, by times on a time line in milliseconds.
#include "driver/open_outs.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace forcegrid::driver {
namespace {

rt::TimePoint at(double ms) { return rt::TimePoint(rt::from_seconds(1.0 + 1e-3 * ms)); }

void send(OpenOuts& outs, double ms) { outs.push({.sent = at(ms), .completed = at(ms + 0.5)}); }

TEST(OpenOuts, AssignsReportsToTheOldest) {
  OpenOuts outs;
  EXPECT_FALSE(outs.answer());
  send(outs, 0.0);
  send(outs, 1.0);
  EXPECT_EQ(outs.newest().sent, at(1.0));
  EXPECT_TRUE(outs.answer());
  EXPECT_EQ(outs.answered().sent, at(0.0));
  EXPECT_TRUE(outs.answer());
  EXPECT_EQ(outs.answered().sent, at(1.0));
  EXPECT_TRUE(outs.empty());
  EXPECT_FALSE(outs.answer());
}

TEST(OpenOuts, GivesALostReportUpAfterFourPromptOnes) {
  OpenOuts outs;
  send(outs, 0.0);  // lost
  outs.doubt();
  send(outs, 40.0);
  for (int i = 0; i < 4; ++i) {
    EXPECT_TRUE(outs.in_doubt());
    EXPECT_TRUE(outs.answer());
    // The oldest that it can be: that OUT, or the one before.
    EXPECT_EQ(outs.answered().sent, i == 0 ? at(0.0) : at(38.0 + 2.0 * i));
    EXPECT_TRUE(outs.judge(at(41.5 + 2.0 * i)));
    if (i < 3) {
      send(outs, 42.0 + 2.0 * i);
    }
  }
  EXPECT_FALSE(outs.in_doubt());
  EXPECT_TRUE(outs.empty());
}

TEST(OpenOuts, DoesNotTakeALateReportForThatOfALaterOut) {
  OpenOuts outs;
  send(outs, 0.0);
  outs.doubt();
  send(outs, 40.0);
  EXPECT_TRUE(outs.answer());
  EXPECT_FALSE(outs.judge(at(50.5)));  // late by 50 ms, or by 10
  EXPECT_TRUE(outs.in_doubt());
  EXPECT_TRUE(outs.answer());
  EXPECT_TRUE(outs.judge(at(90.5)));  // both have come, so each is its own OUT's
  EXPECT_EQ(outs.answered().sent, at(40.0));
  EXPECT_FALSE(outs.in_doubt());
}

// Reports late by D with n on their way: n in a row come within D after their newest OUTs, so with
// at most three on their way and D above 16 ms no four come promptly.
TEST(OpenOuts, NeverBelievesThatLateReportsArePrompt) {
  for (const double late_ms : {17.0, 30.0, 50.0, 100.0}) {
    for (const int on_their_way : {2, 3}) {
      OpenOuts outs;
      outs.doubt();
      std::vector<double> sent_ms;
      for (int i = 0; i < on_their_way; ++i) {
        sent_ms.push_back(0.1 * i);  // as close together as can be: the others come promptly
        send(outs, sent_ms.back());
      }
      bool told = true;
      for (std::size_t i = 0; i < 8; ++i) {
        const double arrival_ms = sent_ms[i] + late_ms;
        ASSERT_TRUE(outs.answer());
        EXPECT_EQ(outs.answered().sent, at(sent_ms[i]));
        told = told && outs.judge(at(arrival_ms));
        sent_ms.push_back(arrival_ms + 0.1);
        send(outs, sent_ms.back());
      }
      EXPECT_FALSE(told);
      EXPECT_TRUE(outs.in_doubt());
    }
  }
}

TEST(OpenOuts, MakesRoomByGivingUpTheOldest) {
  OpenOuts outs;
  for (int i = 0; i < 20; ++i) {
    send(outs, i);
  }
  for (int i = 12; i < 20; ++i) {
    ASSERT_TRUE(outs.answer());
    EXPECT_EQ(outs.answered().sent, at(i));
  }
  EXPECT_FALSE(outs.answer());
}

w2::InputReport report(std::int16_t count) {
  w2::InputReport report;
  report.counts[2] = count;
  return report;
}

TEST(ForeignReplies, ProveASecondProgramWhenTheyDifferAndAreMany) {
  ForeignReplies replies;
  for (std::int16_t i = 1; i < 5; ++i) {
    EXPECT_FALSE(replies.take(report(i), at(i)));
  }
  EXPECT_TRUE(replies.take(report(5), at(5)));
}

TEST(ForeignReplies, ProveNothingWhenTheyRepeatTheOneBefore) {
  ForeignReplies replies;
  replies.answered(report(3));
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(replies.take(report(3), at(i)));
  }
}

// One of sixteen reports comes twice. The second is taken for the next answer, which then comes
// when nothing is asked.
TEST(ForeignReplies, ProveNothingWhenAReportThatCameTwiceWasTakenForTwoAnswers) {
  ForeignReplies replies;
  for (std::int16_t i = 0; i < 1000; ++i) {
    if (i % 16 == 1) {
      EXPECT_FALSE(replies.take(report(i), at(i)));
      continue;
    }
    replies.answered(report(i));
    if (i % 16 == 0) {
      replies.answered(report(i));
    }
  }
}

TEST(ForeignReplies, AreExpectedForAWhileAndInSmallNumbers) {
  ForeignReplies late;
  late.expect(4, at(0.0));
  bool proved = false;
  for (std::int16_t i = 1; i <= 5; ++i) {
    proved = late.take(report(i), at(50.0 + i));
  }
  EXPECT_TRUE(proved);
  ForeignReplies many;
  many.expect(100, at(0.0));
  proved = false;
  for (std::int16_t i = 1; i <= 9; ++i) {
    EXPECT_FALSE(proved);
    proved = many.take(report(i), at(i));
  }
  EXPECT_TRUE(proved);
}

// Each command is answered: 1,000 a second of this program, and 50 a second of another one at any
// time in between. While the arm moves by less than a count per report, little tells a second
// program from a device that repeats itself.
TEST(ForeignReplies, ProveASecondProgramWhenTheArmMoves) {
  constexpr unsigned kSeed = 7;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  for (const double counts_per_ms : {0.8, 2.0}) {
    const auto report_at = [counts_per_ms](double time_ms) {
      return report(static_cast<std::int16_t>(time_ms * counts_per_ms));
    };
    ForeignReplies replies;
    bool proved = false;
    for (int time_ms = 0; time_ms < 10'000 && !proved; ++time_ms) {
      replies.answered(report_at(time_ms));
      if (share(random) < 0.05) {
        const double between_ms = time_ms + share(random);
        proved = replies.take(report_at(between_ms), at(between_ms));
      }
    }
    EXPECT_TRUE(proved) << counts_per_ms << " counts per ms, seed " << kSeed;
  }
}

TEST(ForeignReplies, AreForgottenOneEveryTenSeconds) {
  ForeignReplies rare;
  for (std::int16_t i = 1; i < 100; ++i) {
    EXPECT_FALSE(rare.take(report(i), at(10'000.0 * i)));
  }
  ForeignReplies often;
  bool proved = false;
  for (std::int16_t i = 1; i < 20 && !proved; ++i) {
    proved = often.take(report(i), at(5'000.0 * i));
  }
  EXPECT_TRUE(proved);
}

}  // namespace
}  // namespace forcegrid::driver
