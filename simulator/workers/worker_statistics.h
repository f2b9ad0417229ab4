#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace forcegrid::simulator {

/// What became of one worker and of what it was asked.
struct WorkerRecord {
  std::string name;  ///< as it calls itself: host:process
  bool present = true;
  bool expelled = false;
  std::uint64_t answers = 0;  ///< in time and of use; those that were checked included
  std::uint64_t late = 0;     ///< after the job was taken back, or for a contact that has ended
  std::uint64_t right = 0;    ///< checked, and so
  std::uint64_t wrong = 0;  ///< checked, and not so; no message at all; an answer nobody asked for
  std::uint64_t round_trips = 0;  ///< jobs answered before they were taken back
  double round_trip_sum_s = 0.0;  ///< of those, from giving the job to its answer
};

/// All workers together. Rates and names are for reports; nothing decides by them.
struct WorkerStatistics {
  std::uint64_t strangers = 0;  ///< connections with another key
  std::uint64_t joined = 0;
  std::uint64_t refused = 0;   ///< hellos of workers with another object, or beyond the room
  std::uint64_t gone = 0;      ///< silent for WorkerPool::kSilence
  std::uint64_t expelled = 0;  ///< answered wrongly too often
  std::uint64_t given = 0;     ///< jobs; each ends as answered, taken back or forgotten
  std::uint64_t answered = 0;  ///< in time
  std::uint64_t taken_back =
      0;                       ///< not answered in WorkerPool::kPatience, or by an expelled worker
  std::uint64_t given_up = 0;  ///< taken back as the worker found no finite force
  std::uint64_t late =
      0;  ///< answers that came after their job was taken back, or for a contact that has ended
  std::uint64_t right = 0;      ///< answers that were checked, and so
  std::uint64_t wrong = 0;      ///< WorkerRecord::wrong of all
  std::uint64_t malformed = 0;  ///< messages that are none, whoever sent them
  std::uint64_t unasked = 0;    ///< answers nobody had asked for
  /// In the order in which they joined; at most kMaxRecords, later ones count above alone.
  std::vector<WorkerRecord> workers;
  static constexpr std::size_t kMaxRecords = 256;
};

}  // namespace forcegrid::simulator
