// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace forcegrid::tools {

/// An HDF5 file can't be written or read. what() names file, object and reason.
class Hdf5Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Version of the HDF5 library, e.g. "1.10.8".
std::string hdf5_version();

/// Type of a column's numbers in the file. The interface uses doubles, which hold all of these
/// types exactly (integers up to 2^53).
enum class Hdf5Type { kFloat64, kFloat32, kInt32, kUint8, kUint16, kUint32, kUint64 };

/// One column: a data set that grows by rows, each of the shape `row_shape` (empty: one number).
struct Hdf5Column {
  std::string name;  ///< in the file, "/cycles/position_W_m"
  Hdf5Type type = Hdf5Type::kFloat64;
  std::vector<std::uint64_t> row_shape;
  std::string meaning;  ///< becomes the attribute "meaning"

  std::size_t numbers_per_row() const noexcept;
};

/// Writes a file that is readable at every moment, even after the writer was killed. HDF5's
/// single-writer/multiple-reader mode (SWMR) orders all writes so that a reader always finds a
/// consistent file. After a kill the file must be opened with SWMR, as Hdf5Reader does.
///
/// Construct, add attributes and columns, begin(), then append() and flush(), then close().
/// Real-time: no. Threads: one at a time.
class Hdf5Writer {
 public:
  /// @throws Hdf5Error, as does every other function of this class.
  explicit Hdf5Writer(const std::string& file);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  void add_attribute(const std::string& name, const std::string& text);
  /// Before begin(). Rows are compressed by chunks of `rows_per_chunk`.
  /// @returns the column's number.
  std::size_t add_column(const Hdf5Column& column, std::uint64_t rows_per_chunk);
  /// From here on only rows may be added.
  void begin();
  /// Adds numbers.size() / numbers_per_row() rows.
  void append(std::size_t column, const std::vector<double>& numbers);
  /// What has been appended so far survives a kill.
  void flush();
  /// Idempotent. After a write that failed the file is left as it is.
  void close();

 private:
  struct Column;
  std::string file_;
  std::int64_t id_ = -1;
  bool failed_ = false;  ///< a write did, or is on its way
  std::vector<Column> columns_;
};

/// Reads such a file, closed or not, also while it is written. What a damaged file claims is
/// checked before it is believed, and a checksum that fails is read again for a millisecond at
/// most. Real-time: no. Threads: one at a time.
class Hdf5Reader {
 public:
  /// @throws Hdf5Error, as does every other function of this class: "FILE: damaged: ..." names the
  ///         part that can't be read.
  explicit Hdf5Reader(const std::string& file);
  ~Hdf5Reader();
  Hdf5Reader(const Hdf5Reader&) = delete;
  Hdf5Reader& operator=(const Hdf5Reader&) = delete;

  const std::string& file() const noexcept { return file_; }
  bool has(const std::string& name) const;
  /// Of the file itself; empty if there is none.
  std::string attribute(const std::string& name) const;
  /// Names of the columns in the file's groups, sorted: "/cycles/time_s".
  std::vector<std::string> columns() const;
  /// Type, shape of a row and meaning. A type that Hdf5Type doesn't name is given as doubles.
  Hdf5Column column(const std::string& name) const;
  std::uint64_t rows(const std::string& column) const;
  /// `rows` rows from row `first` on, one row after the other.
  std::vector<double> numbers(const std::string& column, std::uint64_t rows,
                              std::uint64_t first = 0) const;

 private:
  std::vector<std::uint64_t> shape_of(std::int64_t dataset, const std::string& column) const;

  std::string file_;
  std::uint64_t size_bytes_ = 0;
  std::int64_t id_ = -1;
};

/// Adds to a file that was closed: texts as attributes of the file, and whole columns.
/// @throws Hdf5Error.
void add_to_hdf5(const std::string& file,
                 const std::vector<std::pair<std::string, std::string>>& attributes,
                 const std::vector<std::pair<Hdf5Column, std::vector<double>>>& columns);

}  // namespace forcegrid::tools
