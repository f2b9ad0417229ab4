// SPDX-License-Identifier: Apache-2.0
#include "tools/recorder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <filesystem>
#include <optional>

#include "forcegrid/core/force_method.h"
#include "rt/thread.h"
#include "rt/vectors.h"
#include "servo_loop/fault.h"
#include "tools/hdf5_file.h"

namespace forcegrid::tools {
namespace {

using servo::ArrivedSample;
using servo::CycleRecord;
using servo::Triple;

constexpr auto kWritePeriod = std::chrono::seconds(1);
constexpr std::uint64_t kSamplesPerChunk = 64;

// A column and where its numbers come from.
template <typename Row>
struct Source {
  Hdf5Column column;
  std::function<void(const Row&, std::vector<double>&)> take;
  std::size_t number = 0;  ///< in the file
};

template <typename Row, typename Value>
Source<Row> number(std::string name, Hdf5Type type, Value Row::*member, std::string meaning) {
  return {{std::move(name), type, {}, std::move(meaning)},
          [member](const Row& row, std::vector<double>& to) {
            to.push_back(static_cast<double>(row.*member));
          }};
}

template <typename Value, std::size_t N>
Source<CycleRecord> several(std::string name, Hdf5Type type,
                            std::array<Value, N> CycleRecord::*member, std::string meaning) {
  return {{std::move(name), type, {N}, std::move(meaning)},
          [member](const CycleRecord& row, std::vector<double>& to) {
            for (const Value value : row.*member) {
              to.push_back(static_cast<double>(value));
            }
          }};
}

void take_vector(const Eigen::Vector3d& v, std::vector<double>& to) {
  to.insert(to.end(), {v.x(), v.y(), v.z()});
}

// Work of the force sent; the force of a cycle acts until the next cycle.
class WorkOnHand {
 public:
  double after(const CycleRecord& cycle) {
    if (before_) {
      const Eigen::Vector3d moved =
          rt::to_vector(cycle.position_W_m) - rt::to_vector(before_->position_W_m);
      work_J_ += rt::to_vector(before_->commanded_force_D_N).dot(moved);
    }
    before_ = cycle;
    return work_J_;
  }

 private:
  std::optional<CycleRecord> before_;
  double work_J_ = 0.0;
};

std::vector<Source<CycleRecord>> cycle_sources(std::int64_t start_ns, std::size_t methods,
                                               const std::shared_ptr<WorkOnHand>& work) {
  using T = Hdf5Type;
  const auto of_methods = [methods](std::string name, T type, std::uint64_t numbers,
                                    std::string meaning, auto take) {
    std::vector<std::uint64_t> row_shape{methods};
    if (numbers > 1) {
      row_shape.push_back(numbers);
    }
    return Source<CycleRecord>{{std::move(name), type, std::move(row_shape), std::move(meaning)},
                               [methods, take](const CycleRecord& row, std::vector<double>& to) {
                                 for (std::size_t i = 0; i < methods; ++i) {
                                   take(row, i, to);
                                 }
                               }};
  };
  return {
      {{"/cycles/time_s", T::kFloat64, {}, "start of the cycle since the recording began"},
       [start_ns](const CycleRecord& row, std::vector<double>& to) {
         to.push_back(1e-9 * static_cast<double>(row.time_ns - start_ns));
       }},
      number("/cycles/cycle", T::kUint64, &CycleRecord::cycle,
             "number of the cycle; a gap means cycles lost on the way to the file"),
      number("/cycles/period_us", T::kFloat32, &CycleRecord::period_us,
             "since the start of the previous cycle; 0 in the first"),
      number("/cycles/wakeup_us", T::kFloat32, &CycleRecord::wakeup_us,
             "start of the cycle minus its deadline"),
      number("/cycles/compute_us", T::kFloat32, &CycleRecord::compute_us,
             "from reading the report to the end of the fill step"),
      number("/cycles/report_age_us", T::kFloat32, &CycleRecord::report_age_us,
             "age of the device's report at the start of the cycle"),
      number("/cycles/report_sequence", T::kUint64, &CycleRecord::report_sequence,
             "count of the device's reports"),
      several("/cycles/counts", T::kInt32, &CycleRecord::counts,
              "encoder counts of joints a, b, c"),
      several("/cycles/position_W_m", T::kFloat64, &CycleRecord::position_W_m,
              "tool, in the workspace frame"),
      several("/cycles/touching_W_m", T::kFloat64, &CycleRecord::touching_W_m,
              "where the methods were asked: at the tool, or at the proxy of a virtual coupling"),
      several("/cycles/velocity_W_m_per_s", T::kFloat32, &CycleRecord::velocity_W_m_per_s,
              "of the tool, in the workspace frame"),
      number("/cycles/has_orientation", T::kUint8, &CycleRecord::has_orientation,
             "1 with a wrist; else the orientation is the identity and the angles are 0"),
      several("/cycles/orientation_WT_wxyz", T::kFloat64, &CycleRecord::orientation_WT_wxyz,
              "unit quaternion w, x, y, z from the tool's frame T to the workspace frame; w >= 0"),
      several("/cycles/angular_velocity_W_rad_per_s", T::kFloat32,
              &CycleRecord::angular_velocity_W_rad_per_s,
              "of the tool's frame, in the workspace frame"),
      several("/cycles/tool_torque_W_Nm", T::kFloat64, &CycleRecord::tool_torque_W_Nm,
              "of the object on the tool about its position, with the force that was sent"),
      several("/cycles/gimbal_angle_rad", T::kFloat64, &CycleRecord::gimbal_angle_rad,
              "of the wrist's joints from the arm outward"),
      several("/cycles/gimbal_counts", T::kInt32, &CycleRecord::gimbal_counts,
              "encoder counts d, e, f"),
      number("/cycles/suspected_wrist_encoders", T::kUint8, &CycleRecord::suspected_wrist_encoders,
             "bits 0, 1, 2: encoder d, e, f has not counted for long"),
      number("/cycles/buttons", T::kUint8, &CycleRecord::buttons,
             "buttons that are down: bit i for button i + 1"),
      of_methods("/cycles/asked_force_W_N", T::kFloat64, 3,
                 "each method's force, the rendered method first, before any limit",
                 [](const CycleRecord& row, std::size_t i, std::vector<double>& to) {
                   take_vector(rt::to_vector(row.method_force_W_N[i]), to);
                 }),
      of_methods("/cycles/method_status", T::kUint8, 1, "each method's, see names_method_status",
                 [](const CycleRecord& row, std::size_t i, std::vector<double>& to) {
                   to.push_back(static_cast<double>(row.method_status[i]));
                 }),
      of_methods("/cycles/method_uncertainty_N", T::kFloat32, 1,
                 "each method's standard deviation; NaN: unknown",
                 [](const CycleRecord& row, std::size_t i, std::vector<double>& to) {
                   to.push_back(row.method_uncertainty_N[i]);
                 }),
      several("/cycles/tool_force_W_N", T::kFloat64, &CycleRecord::tool_force_W_N,
              "of other devices' tools on this one, before gain and limits"),
      number("/cycles/rendered_member", T::kUint8, &CycleRecord::rendered_candidate,
             "candidate of the rendered method that was rendered"),
      number("/cycles/rendered_reason", T::kUint8, &CycleRecord::rendered_reason,
             "reason for the candidate, see names_rendered_reason"),
      number("/cycles/rendered_method", T::kUint8, &CycleRecord::rendered_method,
             "method that is rendered, or faded to: its place in method_names"),
      number("/cycles/gain", T::kFloat32, &CycleRecord::gain, "ramp and fade, 0 to 1"),
      number("/cycles/damping_gain", T::kFloat32, &CycleRecord::damping_gain,
             "of the damping field, 0 to 1"),
      number("/cycles/held_back", T::kUint8, &CycleRecord::held_back,
             "why no force is rendered, see names_held_back; 0: it is"),
      several("/cycles/sent_force_D_N", T::kFloat64, &CycleRecord::commanded_force_D_N,
              "after ramp, fade and every limit, in the device frame"),
      several("/cycles/current_A", T::kFloat32, &CycleRecord::current_A, "sent to motors a, b, c"),
      several("/cycles/wrist_current_A", T::kFloat32, &CycleRecord::wrist_current_A,
              "sent to the motors of a wrist"),
      number("/cycles/limits_acted", T::kUint8, &CycleRecord::limits_acted,
             "bits of the limits that acted"),
      number("/cycles/in_contact", T::kUint8, &CycleRecord::in_contact, "1 in contact"),
      number("/cycles/contact_epoch", T::kUint32, &CycleRecord::contact_epoch,
             "a new number at every discontinuity of contact"),
      number("/cycles/samples_taken", T::kUint64, &CycleRecord::samples_taken,
             "samples of the simulator since the start"),
      number("/cycles/arrivals_taken", T::kUint64, &CycleRecord::arrivals_taken,
             "rows of /samples that the methods had got by this cycle"),
      number("/cycles/sample_age_ms", T::kFloat32, &CycleRecord::sample_age_ms,
             "time since the tool was at the position of the newest sample; -1: none"),
      number("/cycles/requests_per_s", T::kFloat64, &CycleRecord::requests_per_s,
             "requests that the rendered method might make"),
      number(
          "/cycles/budget_reads", T::kFloat64, &CycleRecord::budget_reads,
          "the methods' budget, in bare trilinear reads a cycle; infinite: no limit; NaN: as the "
          "methods were made"),
      number("/cycles/missed_deadlines", T::kUint32, &CycleRecord::missed_deadlines,
             "deadlines that passed unserved just before this cycle"),
      number("/cycles/energy_to_hand_J", T::kFloat64, &CycleRecord::energy_to_hand_J,
             "energy that the passivity guard counts for this contact"),
      number("/cycles/passivity_damping_N_s_per_m", T::kFloat32,
             &CycleRecord::passivity_damping_N_s_per_m, "that the guard added"),
      number("/cycles/passivity_scale", T::kFloat32, &CycleRecord::passivity_scale,
             "by which the guard shortened the wanted force"),
      number("/cycles/motor_warmth", T::kFloat32, &CycleRecord::motor_warmth,
             "of the warmest motor: 0 cold, 1 as warm as its continuous current makes it"),
      number("/cycles/rung", T::kUint8, &CycleRecord::rung, "source of the force, see names_rung"),
      number("/cycles/fault", T::kUint8, &CycleRecord::fault, "see names_fault"),
      {{"/cycles/work_on_hand_J",
        T::kFloat64,
        {},
        "work of the force sent on the hand since the recording began; negative: the hand worked"},
       [work](const CycleRecord& row, std::vector<double>& to) {
         to.push_back(work->after(row));
       }}};
}

std::vector<Source<ArrivedSample>> sample_sources(std::int64_t start_ns) {
  using T = Hdf5Type;
  const auto source = [](std::string name, T type, std::vector<std::uint64_t> row_shape,
                         std::string meaning, auto take) {
    return Source<ArrivedSample>{{std::move(name), type, std::move(row_shape), std::move(meaning)},
                                 take};
  };
  const double start_s = 1e-9 * static_cast<double>(start_ns);
  using Row = ArrivedSample;
  using Out = std::vector<double>;
  return {
      source("/samples/time_s", T::kFloat64, {}, "when the tool was at position_W_m",
             [start_s](const Row& row, Out& to) { to.push_back(row.sample.time_s - start_s); }),
      source("/samples/delivered_s", T::kFloat64, {}, "when it reached the servo",
             [start_ns](const Row& row, Out& to) {
               to.push_back(1e-9 *
                            static_cast<double>(row.arrived.time_since_epoch().count() - start_ns));
             }),
      source("/samples/position_W_m", T::kFloat64, {3}, "where the force was computed",
             [](const Row& row, Out& to) { take_vector(row.sample.position_W, to); }),
      source("/samples/force_W_N", T::kFloat64, {3}, "of the object on the tool",
             [](const Row& row, Out& to) { take_vector(row.sample.force_W, to); }),
      source("/samples/has_stiffness", T::kUint8, {}, "1 if stiffness_W_N_per_m is known",
             [](const Row& row, Out& to) { to.push_back(row.sample.has_stiffness); }),
      source("/samples/stiffness_W_N_per_m", T::kFloat64, {3, 3}, "dF/dP, one row a component of F",
             [](const Row& row, Out& to) {
               for (int i = 0; i < 3; ++i) {
                 take_vector(row.sample.stiffness_W.row(i).transpose(), to);
               }
             }),
      source("/samples/in_contact", T::kUint8, {}, "1 in contact",
             [](const Row& row, Out& to) { to.push_back(row.in_contact); }),
      source("/samples/contact_epoch", T::kUint32, {}, "a new number at every discontinuity",
             [](const Row& row, Out& to) { to.push_back(row.sample.contact_epoch); }),
      source("/samples/contact_point_W_m", T::kFloat64, {3}, "where the tool touched",
             [](const Row& row, Out& to) { take_vector(row.sample.contact_point_W, to); }),
      source("/samples/relative_residual", T::kFloat64, {}, "of the simulator's equilibrium",
             [](const Row& row, Out& to) { to.push_back(row.sample.relative_residual); }),
      source("/samples/converged", T::kUint8, {}, "1 if the simulator reached its tolerance",
             [](const Row& row, Out& to) { to.push_back(row.sample.converged); }),
      source("/samples/from_query", T::kUint8, {}, "1 if a method asked for it",
             [](const Row& row, Out& to) { to.push_back(row.sample.from_query); }),
      source("/samples/has_torque", T::kUint8, {}, "1 if torque_W_Nm is known",
             [](const Row& row, Out& to) { to.push_back(row.has_torque); }),
      source("/samples/torque_W_Nm", T::kFloat64, {3},
             "of the object on the tool, about position_W_m",
             [](const Row& row, Out& to) { take_vector(row.torque_W_Nm, to); }),
      source("/samples/orientation_WT_wxyz", T::kFloat64, {4},
             "unit quaternion of the tool that the torque was computed for",
             [](const Row& row, Out& to) {
               to.insert(to.end(), row.orientation_WT_wxyz.begin(), row.orientation_WT_wxyz.end());
             })};
}

std::vector<Source<RecordedTool>> other_tool_sources(std::int64_t start_ns) {
  using T = Hdf5Type;
  using Row = RecordedTool;
  using Out = std::vector<double>;
  return {
      {{"/others/time_s", T::kFloat64, {}, "when the simulator's message reached the servo"},
       [start_ns](const Row& row, Out& to) {
         to.push_back(1e-9 * static_cast<double>(row.arrived_ns - start_ns));
       }},
      {{"/others/tool", T::kUint32, {}, "number of the other tool; 0: it has none"},
       [](const Row& row, Out& to) { to.push_back(row.tool.tool); }},
      {{"/others/in_contact", T::kUint8, {}, "1 if that tool touches the object"},
       [](const Row& row, Out& to) { to.push_back(row.tool.in_contact); }},
      {{"/others/age_ms",
        T::kFloat64,
        {},
        "how long the simulator had known the position when it sent the message"},
       [](const Row& row, Out& to) { to.push_back(1e-6 * static_cast<double>(row.tool.age_ns)); }},
      {{"/others/position_W_m", T::kFloat64, {3}, "of that tool, in the workspace frame"},
       [](const Row& row, Out& to) { take_vector(rt::to_vector(row.tool.position_W_m), to); }}};
}

template <typename Row>
void write_rows(Hdf5Writer& writer, const std::vector<Source<Row>>& sources,
                const std::vector<Row>& rows) {
  std::vector<double> numbers;
  for (const Source<Row>& source : sources) {
    numbers.clear();
    for (const Row& row : rows) {
      source.take(row, numbers);
    }
    writer.append(source.number, numbers);
  }
}

template <typename Enum>
std::string names(int count, const char* (*name)(Enum) noexcept) {
  std::string text;
  for (int i = 0; i < count; ++i) {
    text.append(i == 0 ? "" : ";").append(name(static_cast<Enum>(i)));
  }
  return text;
}

std::uintmax_t free_bytes_at(const std::string& file) {
  std::error_code error;
  const auto folder = std::filesystem::absolute(file, error).parent_path();
  return std::filesystem::space(folder, error).available;
}

}  // namespace

// The file's columns, filled from rows.
class Recorder::Pages {
 public:
  Pages(const RecorderOptions& options, std::int64_t start_ns)
      : writer_(options.file),
        cycles_(
            cycle_sources(start_ns, options.method_names.size(), std::make_shared<WorkOnHand>())),
        samples_(sample_sources(start_ns)),
        other_tools_(options.other_tools ? other_tool_sources(start_ns)
                                         : std::vector<Source<RecordedTool>>()) {
    std::string methods;
    for (const std::string& name : options.method_names) {
      methods += (methods.empty() ? "" : ";") + name;
    }
    writer_.add_attribute("format", "forcegrid recording 1");
    writer_.add_attribute("method_names", methods);
    writer_.add_attribute("names_method_status", names<EstimateStatus>(5, forcegrid::to_string));
    writer_.add_attribute("names_rendered_reason",
                          names<ChoiceReason>(kChoiceReasons, forcegrid::to_string));
    writer_.add_attribute("names_held_back",
                          "force is rendered;no samples;motor check;dead-man's switch;paused");
    writer_.add_attribute(
        "names_fault",
        names<servo::Fault>(1 + static_cast<int>(servo::Fault::kZeroNotDelivered), servo::name_of));
    writer_.add_attribute("names_rung", names<servo::Rung>(servo::kRungs, servo::to_string));
    writer_.add_attribute("start_monotonic_ns", std::to_string(start_ns));
    for (const auto& [name, text] : options.attributes) {
      writer_.add_attribute(name, text);
    }
    const auto per_second = static_cast<std::uint64_t>(std::lround(options.rate_Hz));
    for (auto& source : cycles_) {
      source.number = writer_.add_column(source.column, per_second);
    }
    for (auto& source : samples_) {
      source.number = writer_.add_column(source.column, kSamplesPerChunk);
    }
    for (auto& source : other_tools_) {
      source.number = writer_.add_column(source.column, kSamplesPerChunk);
    }
    if (options.surface) {
      surface_.emplace(writer_, start_ns);
    }
    writer_.begin();
  }

  void write(const std::vector<CycleRecord>& cycles, const std::vector<ArrivedSample>& samples,
             const std::vector<RecordedTool>& other_tools, const Surfaces& surfaces) {
    write_rows(writer_, cycles_, cycles);
    write_rows(writer_, samples_, samples);
    write_rows(writer_, other_tools_, other_tools);
    for (const RecordedShape& shape : surfaces.shapes) {
      surface_->write(shape);
    }
    for (const RecordedFrame& frame : surfaces.frames) {
      surface_->write(frame);
    }
    writer_.flush();
  }
  void close() { writer_.close(); }

 private:
  Hdf5Writer writer_;
  std::vector<Source<CycleRecord>> cycles_;
  std::vector<Source<ArrivedSample>> samples_;
  std::vector<Source<RecordedTool>> other_tools_;
  std::optional<SurfaceColumns> surface_;
};

Recorder::Recorder(RecorderOptions options)
    : options_(std::move(options)),
      start_ns_(rt::Clock::now().time_since_epoch().count()),
      pages_(std::make_unique<Pages>(options_, start_ns_)) {
  if (!options_.free_bytes) {
    options_.free_bytes = free_bytes_at;
  }
  thread_ = std::thread([this] {
    rt::name_current_thread("recorder");
    write_until_end();
  });
}

Recorder::~Recorder() { finish(); }

void Recorder::push(const CycleRecord& cycle) {
  const std::lock_guard lock(mutex_);
  if (gave_up_ || cycles_.size() >= kLargestQueue) {
    ++end_.cycles_lost;
  } else {
    cycles_.push_back(cycle);
  }
}

void Recorder::push(const ArrivedSample& sample) {
  const std::lock_guard lock(mutex_);
  if (gave_up_ || samples_.size() >= kLargestQueue) {
    ++end_.samples_lost;
  } else {
    samples_.push_back(sample);
  }
}

void Recorder::push(const RecordedTool& tool) {
  const std::lock_guard lock(mutex_);
  if (!options_.other_tools) {
    return;
  }
  if (gave_up_ || other_tools_.size() >= kLargestQueue) {
    ++end_.samples_lost;
  } else {
    other_tools_.push_back(tool);
  }
}

void Recorder::push(RecordedShape shape) {
  const std::lock_guard lock(mutex_);
  const std::size_t bytes = 12 * (shape.rest_W_m.size() + shape.corners.size());
  if (options_.surface && !gave_up_ && surface_bytes_ + bytes <= 2 * kMostSurfaceBytes) {
    surface_bytes_ += bytes;
    surfaces_.shapes.push_back(std::move(shape));
  }
}

void Recorder::push(RecordedFrame frame) {
  const std::lock_guard lock(mutex_);
  const std::size_t bytes = 6 * frame.value.size();
  if (!options_.surface || gave_up_) {
    return;
  }
  if (surface_bytes_ + bytes > kMostSurfaceBytes ||
      !surface_bound_.take(1e-9 * static_cast<double>(frame.arrived_ns - start_ns_), bytes)) {
    ++end_.surface_frames_left_out;
    return;
  }
  surface_bytes_ += bytes;
  surfaces_.frames.push_back(std::move(frame));
}

std::string Recorder::trouble_so_far() const {
  const std::lock_guard lock(mutex_);
  return end_.trouble;
}

const RecorderEnd& Recorder::finish() {
  {
    const std::lock_guard lock(mutex_);
    end_requested_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) {
    thread_.join();
  }
  return end_;
}

void Recorder::write_until_end() {
  std::vector<CycleRecord> cycles;
  std::vector<ArrivedSample> samples;
  std::vector<RecordedTool> other_tools;
  Surfaces surfaces;
  for (bool last = false; !last;) {
    {
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, kWritePeriod, [this] { return end_requested_; });
      last = end_requested_;
      cycles.clear();
      samples.clear();
      other_tools.clear();
      std::swap(cycles, cycles_);
      std::swap(samples, samples_);
      std::swap(other_tools, other_tools_);
      surfaces = std::exchange(surfaces_, {});
      surface_bytes_ = 0;
    }
    write(cycles, samples, other_tools, surfaces);
  }
  if (pages_) {
    try {
      pages_->close();
      end_.closed = true;
    } catch (const std::exception& error) {
      give_up(error.what());
    }
  }
  if (end_.trouble.empty() && end_.cycles_lost + end_.samples_lost > 0) {
    end_.trouble =
        std::to_string(end_.cycles_lost) + " cycles and " + std::to_string(end_.samples_lost) +
        " samples were lost because the disk was too slow; they are missing in " + options_.file;
  }
}

void Recorder::write(const std::vector<CycleRecord>& cycles,
                     const std::vector<ArrivedSample>& samples,
                     const std::vector<RecordedTool>& other_tools, const Surfaces& surfaces) {
  if (!pages_) {
    const std::lock_guard lock(mutex_);
    end_.cycles_lost += cycles.size();
    end_.samples_lost += samples.size() + other_tools.size();
    return;
  }
  try {
    if (options_.free_bytes(options_.file) < options_.keep_free_bytes) {
      pages_->close();
      end_.closed = true;
      give_up("less than " + std::to_string(options_.keep_free_bytes >> 20) +
              " MB are free on the disk of " + options_.file +
              "; the recording ends here, complete so far. Free some space");
    } else {
      pages_->write(cycles, samples, other_tools, surfaces);
      end_.surface_frames += surfaces.frames.size();
      end_.cycles += cycles.size();
      end_.samples += samples.size();
      return;
    }
  } catch (const std::exception& error) {
    give_up(std::string(error.what()) +
            "; the recording ends here, and what is in the file may not be readable. Free some "
            "space or repair the disk");
  }
  const std::lock_guard lock(mutex_);
  end_.cycles_lost += cycles.size();
  end_.samples_lost += samples.size() + other_tools.size();
}

void Recorder::give_up(const std::string& sentence) {
  pages_.reset();
  {
    const std::lock_guard lock(mutex_);
    gave_up_ = true;
    end_.trouble = sentence;
  }
  if (options_.trouble) {
    options_.trouble(sentence);
  }
}

}  // namespace forcegrid::tools
