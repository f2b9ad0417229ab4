// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "evaluation/files/text_file.h"

namespace forcegrid::evaluation {

/// Reads the rows of a trace: CSV whose first line names the columns, in any order.
/// Columns are numbered as in `names`. Everything that is wrong with the file is thrown as a
/// TraceError that names file, line and column.
/// Real-time: no. Threads: one.
class TraceColumns {
 public:
  /// Reads the header.
  /// @param names all columns that the file may have; they outlive this object.
  /// @param required so many of the first must be there.
  /// @param header_form what to write, for messages.
  /// @throws TraceError, also for an empty file; FileError if the file can't be read.
  TraceColumns(const std::string& file, std::span<const std::string_view> names,
               std::size_t required, const std::string& header_form);

  /// Goes to the next row that is not blank. @returns false after the last one.
  bool next();

  bool has(std::size_t column) const { return seen_[column]; }  ///< in the header
  /// The row's field, without blanks at its ends; empty for a column that the file does not have.
  std::string_view field(std::size_t column) const { return fields_[column]; }
  bool empty(std::size_t column) const { return fields_[column].empty(); }
  /// @throws TraceError unless the field is a finite number.
  double number(std::size_t column) const;
  std::optional<double> optional_number(std::size_t column) const;
  /// Three numbers from column `first` on.
  Eigen::Vector3d vector(std::size_t first) const;
  /// @throws TraceError if the header has some of the columns `first` to before `end`, but not all.
  /// @param how_many  they are, in words.
  void all_or_none(std::size_t first, std::size_t end, const std::string& how_many) const;
  /// A stiffness [N/m], row after row from column `first` on. @returns false if all fields are
  /// empty.
  /// @throws TraceError if some are. @param how_many  entries it has, in words.
  bool stiffness(std::size_t first, Eigen::Ref<Eigen::MatrixXd> entries,
                 const std::string& how_many) const;
  /// A number, or zero for an empty field. @throws TraceError for a negative one.
  double zero_or_more(std::size_t column) const;
  /// A time after that of the row before. @param kind of the row before, for the message.
  double time_after(std::size_t column, std::optional<double> before_s,
                    std::string_view kind) const;
  /// A time that is not before that of column `since`. @param what that is, for the message: empty,
  /// or ", the time of ...".
  double not_before(std::size_t column, std::size_t since, std::string_view what) const;

  /// @throws TraceError: "FILE, line N: what", or "FILE, line N: column 'c': what".
  [[noreturn]] void refuse(const std::string& what) const;
  [[noreturn]] void refuse(std::size_t column, const std::string& what) const;

 private:
  void read_header(std::string_view line, std::size_t required, const std::string& header_form);
  void read_fields(std::string_view line);

  std::string file_;
  std::span<const std::string_view> names_;
  LineReader lines_;
  std::vector<bool> seen_;
  std::vector<std::size_t> columns_;  ///< column of each field
  std::vector<std::string_view> fields_;
};

/// Time of the last of some rows, if there is one.
template <typename Rows>
std::optional<double> last_time_s(const Rows& rows) {
  return rows.empty() ? std::nullopt : std::optional<double>(rows.back().time_s);
}

/// Text of one row of a trace with `column_count` columns; what is not added is left empty.
class TraceRow {
 public:
  explicit TraceRow(std::size_t column_count) : column_count_(column_count) {}

  /// The first three columns. @param delivered_s  nothing: left empty
  void start(std::string_view kind, double time_s, std::optional<double> delivered_s);
  void add(double value);
  void add(const Eigen::Vector3d& values);
  void skip();
  /// The whole row with its end of line.
  const std::string& finish();

 private:
  std::size_t column_count_;
  std::string text_;
  std::size_t fields_ = 0;
};

/// Refuses what would not read back before a trace is written.
class TraceCheck {
 public:
  /// @throws TraceError, as all functions, which name the file: here for a trace without servo
  /// instants.
  TraceCheck(std::string file, std::size_t servo_instants);

  /// The next instant.
  void servo_instant(double time_s, bool finite);
  [[noreturn]] void refuse(const char* kind, std::size_t index, const char* what) const;

 private:
  std::string file_;
  std::size_t instants_ = 0;
  double before_s_ = 0.0;
};

/// A row of a trace that is to be written, and its place among those of its kind.
struct TraceRowPlace {
  /// The order of rows that arrive at the same time.
  enum class Kind { kContact, kSample, kServo };

  double arrival_s = 0.0;
  Kind kind = Kind::kContact;
  std::size_t index = 0;
};

/// When the rows of a trace arrive [s], each kind in its order.
struct TraceArrivals {
  std::vector<double> contacts_s;
  std::vector<double> samples_s;
  std::vector<double> servo_s;
};

/// @param contacts, samples, servo  of a trace of any number of tools.
template <typename Contacts, typename Samples, typename Instants>
TraceArrivals arrivals_of(const Contacts& contacts, const Samples& samples, const Instants& servo) {
  TraceArrivals arrivals;
  for (const auto& contact : contacts) {
    arrivals.contacts_s.push_back(contact.delivered_s.value_or(contact.time_s));
  }
  for (const auto& sample : samples) {
    arrivals.samples_s.push_back(sample.delivered_s);
  }
  for (const auto& instant : servo) {
    arrivals.servo_s.push_back(instant.time_s);
  }
  return arrivals;
}

/// All rows in the order in which they are written, that of their arrival.
std::vector<TraceRowPlace> rows_in_order(const TraceArrivals& arrivals);

/// A number as traces write it: the shortest text that reads back as exactly `value`.
std::string number_text(double value);

}  // namespace forcegrid::evaluation
