// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace forcegrid::simulator {

/// Counts of one worker.
struct WorkerRecord {
  std::string name;  ///< as the worker gave it: host:process
  bool present = true;
  bool expelled = false;
  std::uint64_t answers = 0;      ///< in time, checked ones included
  std::uint64_t late = 0;         ///< after the job was taken back, or for a contact that has ended
  std::uint64_t right = 0;        ///< checked and right
  std::uint64_t wrong = 0;        ///< checked and wrong, unreadable, or not requested
  std::uint64_t round_trips = 0;  ///< jobs answered before they were taken back
  double round_trip_sum_s = 0.0;  ///< sum of the times from job to answer
};

/// Counts of all workers, for reports only.
struct WorkerStatistics {
  std::uint64_t strangers = 0;  ///< connections refused because of another key
  std::uint64_t joined = 0;
  std::uint64_t refused = 0;   ///< hellos with another object, or beyond kMaxWorkers
  std::uint64_t gone = 0;      ///< silent for WorkerPool::kSilence
  std::uint64_t expelled = 0;  ///< answered wrongly too often
  std::uint64_t given = 0;     ///< jobs; each is answered, taken back or dropped
  std::uint64_t answered = 0;  ///< in time
  std::uint64_t taken_back =
      0;                       ///< not answered in WorkerPool::kPatience, or by an expelled worker
  std::uint64_t given_up = 0;  ///< taken back because the worker found no finite force
  std::uint64_t late =
      0;  ///< answers that came after their job was taken back, or for a contact that has ended
  std::uint64_t right = 0;      ///< answers checked and right
  std::uint64_t wrong = 0;      ///< WorkerRecord::wrong of all
  std::uint64_t malformed = 0;  ///< messages that could not be read
  std::uint64_t unasked = 0;    ///< answers that were not requested
  /// In the order in which they joined; at most kMaxRecords, later ones count above alone.
  std::vector<WorkerRecord> workers;
  static constexpr std::size_t kMaxRecords = 256;
};

}  // namespace forcegrid::simulator
