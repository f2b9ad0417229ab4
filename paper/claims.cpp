// SPDX-License-Identifier: Apache-2.0
#include "paper/claims.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <stdexcept>

namespace forcegrid::paper {
namespace {

constexpr std::size_t kStreaming = 0;  // of figure_methods()
constexpr std::size_t kMillimetres = 1;
constexpr std::size_t kMetres = 2;
constexpr double kVerySimilar_percent = 5.0;
constexpr double kConsistent_percent = 90.0;
constexpr double kOnePercent = 1.0;
constexpr double kForceJnd = 0.07;

__attribute__((format(printf, 1, 2))) std::string text(const char* format, ...) {
  char buffer[512];
  std::va_list values;
  va_start(values, format);
  std::vsnprintf(buffer, sizeof buffer, format, values);
  va_end(values);
  return buffer;
}

Outcome agrees_if(bool condition) { return condition ? Outcome::kAgrees : Outcome::kDiffers; }

// "4 %, 9 %, ..." for one method.
std::string by_fifths(const std::vector<Fifth>& fifths, std::size_t method) {
  std::string words;
  for (const Fifth& fifth : fifths) {
    words += (words.empty() ? "" : ", ") + text("%.1f", fifth.rms_error_percent[method]);
  }
  return words + " % of the RMS force";
}

void add_figures(const Figures& figures, std::vector<Claim>& claims) {
  const std::vector<Fifth>& fifths = figures.fifths;
  const auto error = [&fifths](std::size_t fifth, std::size_t method) {
    return fifths[fifth].rms_error_percent[method];
  };
  const std::size_t last = fifths.size() - 1;
  bool rises = true;
  for (std::size_t i = 0; i < last; ++i) {
    rises = rises && error(i + 1, kStreaming) > error(i, kStreaming);
  }
  claims.push_back({"Figure 8, streaming", "the error rises as the tool moves faster",
                    "by fifths of the motion " + by_fifths(fifths, kStreaming), agrees_if(rises),
                    "it rises from each fifth to the next",
                    "this simulator converges at every tick; the paper's did not during fast "
                    "motion, so its streaming was worse"});
  claims.push_back({"Figure 8, forcegrid", "the error falls with time",
                    "by fifths " + by_fifths(fifths, kMillimetres),
                    agrees_if(error(last, kMillimetres) < error(0, kMillimetres)),
                    "it is less in the last fifth than in the first",
                    "the paper leaves the unit of d in 1 + d^2 open; here d is in millimetres"});
  claims.push_back({"Figure 8, forcegrid with d in metres", "the same",
                    "by fifths " + by_fifths(fifths, kMetres),
                    agrees_if(error(last, kMetres) < error(0, kMetres)),
                    "it is less in the last fifth than in the first",
                    "in metres 1 + d^2 is about 1; the weight is then a cone over the whole of r, "
                    "and the field a moving average that is too soft"});
  claims.push_back({"Figure 7, forcegrid",
                    "becomes very similar to the reference force, at any speed",
                    text("%.1f %% in the last fifth, at up to %.0f mm/s", error(last, kMillimetres),
                         1e3 * fifths[last].top_speed_m_per_s),
                    agrees_if(error(last, kMillimetres) < kVerySimilar_percent),
                    text("below %.0f %% in the last fifth", kVerySimilar_percent),
                    "averaging the forces of other places renders too little stiffness, and more "
                    "data do not change that; in a picture, the two curves look alike"});
  claims.push_back(
      {"Figure 8, either", "the forcegrid is better than streaming",
       text("%.1f %% against %.1f %% in the last fifth, %.1f %% against %.1f %% in the first",
            error(last, kMillimetres), error(last, kStreaming), error(0, kMillimetres),
            error(0, kStreaming)),
       agrees_if(error(last, kMillimetres) < error(last, kStreaming)),
       "it is better in the last fifth",
       "true on this motion, which repeats one line; false on motions in three dimensions, see "
       "docs/accuracy.md"});
  const evaluation::Verdict& grid = figures.played[kMillimetres].verdict;
  claims.push_back(
      {"Smoothness", "no perceptible discontinuities or tremors",
       text(
           "largest step of the force's error between two cycles %.0f mN, %.1f %% of the RMS force",
           1e3 * grid.largest_step_N, 100.0 * grid.largest_step_N / grid.reference_rms_N),
       agrees_if(grid.largest_step_N < kForceJnd * grid.reference_rms_N),
       "below 7 % of the RMS force, a person's just noticeable difference of force",
       "a step occurs when a new answer changes the vertices around the tool, and is largest while "
       "the grid has few samples; the paper asked people"});
  claims.push_back({"First contact", "no force for 1/30 s, imperceptible",
                    text("%.0f ms until the first answer with a force; until then, up to %.3f N "
                         "were not rendered",
                         1e3 * figures.blind_s, figures.unfelt_N),
                    agrees_if(figures.unfelt_N < kForceJnd * grid.reference_rms_N),
                    "less than 7 % of the RMS force is missed",
                    "the answer after one period is for the instant of the grab, when there is no "
                    "force; the first informative answer comes after two periods"});
}

void add_timing(const Timing& timing, std::vector<Claim>& claims) {
  const char* const machine =
      "the processor is a quarter of a century newer and has SIMD; the paper used a Celeron of 500 "
      "MHz";
  const auto add = [&](const char* topic, const char* paper, const std::string& here,
                       const char* why) {
    claims.push_back({topic, paper, here, Outcome::kOtherMachine, "not compared", why});
  };
  add("Query", "5 us",
      text("%.1f ns, %.2f times a bare eight-load read", timing.query_ns,
           timing.query_ns / timing.bare_read_ns),
      machine);
  add("Update of one vertex", "1 us", text("%.2f ns", timing.vertex_ns), machine);
  claims.push_back(
      {"Vertices within r of a sample", "about 3,000",
       text("%zu, r = %.1f mm", timing.vertices_within_r, 1e3 * timing.influence_radius_m),
       agrees_if(timing.vertices_within_r > 1500 && timing.vertices_within_r < 6000),
       "within a factor of 2",
       "a sixth of 'the size of W' is taken as a sixth of its longest edge, 0.16 m of 0.16 x 0.12 "
       "x 0.12 m; in a cube the number would be 2,281"});
  add("Whole fill", "3 ms, 1.5 of the 2 ms cycles",
      text("%.1f us, %.4f of a cycle", timing.fill_us, 1e-3 * timing.fill_us / 2.0), machine);
  claims.push_back({"Vertices a cycle", "up to 2,000", text("%.0f", timing.vertices_per_cycle),
                    agrees_if(timing.vertices_per_cycle >= 2000.0), "at least as many",
                    "a whole fill fits into one cycle; the loop splits it only to limit peaks"});
  claims.push_back(
      {"Vertices between two answers", "up to 33,000, ten times what is needed",
       text("%.0f, %.0f times what is needed", timing.vertices_per_answer,
            timing.vertices_per_answer / static_cast<double>(timing.vertices_within_r)),
       agrees_if(timing.vertices_per_answer >=
                 10.0 * static_cast<double>(timing.vertices_within_r)),
       "at least ten times the vertices within r", ""});
  claims.push_back({"Memory of the grid", "1 Mbyte",
                    text("%.2f MB, in two grids", 1e-6 * static_cast<double>(timing.memory_bytes)),
                    agrees_if(timing.memory_bytes < 1'000'000), "below 1,000,000 bytes",
                    "125,000 vertices of three floats and a weight take 2.0 MB, rounded up to "
                    "whole SIMD segments; an empty second grid is ready for the next contact. 1 "
                    "Mbyte would need 16-bit numbers"});
}

const ResolutionRow& row_at(const std::vector<ResolutionRow>& rows, const std::string& motion,
                            int vertices, double of_workspace) {
  for (const ResolutionRow& row : rows) {
    if (row.motion == motion && row.vertices == vertices &&
        std::abs(row.radius_of_workspace - of_workspace) < 1e-9) {
      return row;
    }
  }
  throw std::logic_error("no such resolution was tried");
}

void add_resolutions(const std::vector<ResolutionRow>& rows, const std::string& motion,
                     std::vector<Claim>& claims) {
  const ResolutionRow& papers = row_at(rows, motion, 50, 1.0 / 6);
  const ResolutionRow* best = &papers;
  for (const ResolutionRow& row : rows) {
    if (row.motion == motion && row.rms_error_percent < best->rms_error_percent) {
      best = &row;
    }
  }
  const bool close = papers.rms_error_percent <= best->rms_error_percent + kOnePercent;
  claims.push_back(
      {"Resolution and r, " + motion, "50 x 50 x 50 with r = 1/6 of the workspace is adequate",
       text("%.1f %%; the best tried, %.1f %%, is %d^3 with r = 1/%.0f", papers.rms_error_percent,
            best->rms_error_percent, best->vertices, 1.0 / best->radius_of_workspace),
       agrees_if(close), "within 1 % of the RMS force of the best one tried",
       "averaging over r makes the forcegrid too soft; a smaller r is better until holes open "
       "between the visited places"});
  claims.push_back({"Rule for r, " + motion, "2 to 3 times the tool's travel between two answers",
                    text("best at %.1f times the longest travel (1/6 of the workspace: %.1f times)",
                         best->radius_over_travel, papers.radius_over_travel),
                    agrees_if(best->radius_over_travel >= 1.5 && best->radius_over_travel <= 4.0),
                    "the best is between 1.5 and 4",
                    "the best r is just large enough to leave no holes"});
  claims.push_back(
      {"Rule for the resolution, " + motion, "vertices r/10 to r/5 apart",
       text("best at %.2f r, the paper's own grid at %.2f r", best->spacing_over_radius,
            papers.spacing_over_radius),
       agrees_if(best->spacing_over_radius >= 0.05 && best->spacing_over_radius <= 0.4),
       "the best is within a factor of 2 of that",
       "a small r spans few vertices; a finer grid gains little for its memory"});
}

const DiscriminationRow& discrimination_row(const Discrimination& all, const std::string& method,
                                            Knowledge knowledge, double weber) {
  for (const DiscriminationRow& row : all.rows) {
    if (row.method == method && row.knowledge == knowledge && row.contrast == 1.0 &&
        row.weber_fraction == weber) {
      return row;
    }
  }
  throw std::logic_error("no such observer was asked");
}

std::string of_100(const Proportion& answers) {
  return text("%.0f %% right (95 %%: %.0f to %.0f, %zu trials)", answers.percent(),
              answers.low_percent(), answers.high_percent(), answers.trials);
}

void add_discrimination(const Discrimination& all, std::vector<Claim>& claims) {
  const char* const rule = "the interval's lower end is above 90 %";
  const auto add = [&](const char* topic, const char* method, Knowledge knowledge,
                       const char* why) {
    const Proportion& answers = discrimination_row(all, method, knowledge, kForceJnd).answers;
    claims.push_back({topic, "users consistently tell the three objects apart", of_100(answers),
                      agrees_if(answers.low_percent() > kConsistent_percent), rule, why});
  };
  add("Three objects, forcegrid", "forcegrid", Knowledge::kSameRendering,
      "an ideal observer with a person's errors replaces people; it has learned the objects "
      "through the forcegrid, as the paper's users did");
  add("Three objects, by their real forces", "forcegrid", Knowledge::kRealForces,
      "the same, but the observer knows how the real objects feel");
  add("Three objects, d in metres, by their real forces", "forcegrid unit=m",
      Knowledge::kRealForces,
      "in metres less than a third of the stiffness is rendered: a stiff object feels as the soft "
      "one does");
}

void add_shapes(const std::vector<ShapeDifference>& shapes, std::vector<Claim>& claims) {
  const ShapeDifference& like = shapes.at(0);
  claims.push_back(
      {"By eye alone, stiff and soft", "users are unable to tell them apart",
       text("surfaces differ by %.2g mm (RMS), %.2g mm at most", like.rms_mm, like.largest_mm),
       agrees_if(like.d_prime < 0.1), "d' of an ideal observer below 0.1",
       "nobody could: with the tool at the same position, springs that are all three times as "
       "stiff take the same shape"});
  const ShapeDifference& varied = shapes.at(1);
  claims.push_back(
      {"By eye alone, varied", "users are unable to tell it apart",
       text("surfaces differ by %.2f mm (RMS), %.1f %% of how far they move, %.1f mm at most",
            varied.rms_mm, varied.of_motion_percent, varied.largest_mm),
       agrees_if(varied.d_prime < 0.1), "d' of an ideal observer below 0.1",
       text("an observer who knows every vertex of both shapes could (d' = %.0f); a person who has "
            "not memorised them sees two plausible dents",
            varied.d_prime)});
}

}  // namespace

const char* to_string(Outcome outcome) noexcept {
  switch (outcome) {
    case Outcome::kAgrees:
      return "agrees";
    case Outcome::kDiffers:
      return "differs";
    case Outcome::kOtherMachine:
      return "another machine";
  }
  return "";
}

std::vector<Claim> claims_of(const Results& results) {
  std::vector<Claim> claims;
  add_figures(results.figures, claims);
  add_timing(results.timing, claims);
  std::vector<std::string> motions;
  for (const ResolutionRow& row : results.resolutions) {
    if (std::find(motions.begin(), motions.end(), row.motion) == motions.end()) {
      motions.push_back(row.motion);
      add_resolutions(results.resolutions, row.motion, claims);
    }
  }
  add_discrimination(results.discrimination, claims);
  add_shapes(results.shapes, claims);
  return claims;
}

}  // namespace forcegrid::paper
