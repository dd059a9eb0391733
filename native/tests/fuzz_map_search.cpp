// The ladder of effort, on maps, scans and templates that hold any numbers.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/query/answered.hpp"
#include "hostile.hpp"
#include "random_map.hpp"

namespace firstfix::tests {
namespace {

constexpr std::uint64_t kNumber = 7;  // of the query

// Finds any templates, and cancels the query now and then.
Describe by_chance(Hostile& random, std::size_t templates, Cancellation::Word& cancelled) {
  return [&random, templates, &cancelled](const QueriedScan&, const LevelledScan& levelled) {
    if (random.chance(0.01)) cancelled = kNumber;
    for (const auto& row : levelled.R_level_sensor) {
      for (const double number : row) expect(std::fabs(number) <= 1 + 1e-6, "a rotation");
    }
    return FindTemplates([&random, templates](const std::optional<Sphere>&, std::size_t, const TemplateRows* among) {
      expect(among == nullptr || std::is_sorted(among->begin(), among->end()), "rows that ascend");
      Matches found;
      for (std::int64_t i = templates == 0 ? 0 : random.number(0, 30); i > 0; --i) {
        found.rows.push_back(random.number(0, static_cast<std::int64_t>(templates) - 1));
        found.yaw_rad.push_back(random.real(3, 0)), found.score.push_back(static_cast<float>(random.real(1, 0)));
      }
      return found;
    });
  };
}

SearchOptions options(Hostile& random, const Cancellation::Word& cancelled) {
  SearchOptions made{std::nullopt, std::nullopt, {0, 0, 1}, std::nullopt, random.real(1), Deadline()};
  if (random.chance(0.3)) made.prior = PriorRegion{pose(random, 0), {random.real(4, 0), 0, 0}, 5, random.real(180, 0), 90};
  if (random.chance(0.3)) made.gravity = detail::Vector3{0.1, 0.2, -9.8};
  if (random.chance(0.3)) made.max_candidates = static_cast<std::size_t>(random.number(1, 9));
  if (random.chance(0.2)) made.deadline = Deadline::after_s(-1);
  made.deadline = made.deadline.unless({cancelled, kNumber});
  return made;
}

void check(const MapSearch& search) {
  const RegisteredPoses& found = search.found();
  for (std::size_t i = 0; i < found.size(); ++i) {
    expect(std::isfinite(found[i].support), "a support");
    expect(i == 0 || found[i - 1].support >= found[i].support, "best first");
  }
  expect(search.outside_lead() >= 0, "a lead");
  expect(!search.taken().empty(), "the first step is always taken");
}

void check(const Answered& answer, bool has_base) {
  const bool is_localized = answer.decision.why == Why::kLocalized;
  expect(answer.pose.has_value() == is_localized, "a pose of a localized query alone");
  expect(!is_localized || (!answer.places.empty() && answer.pose->T_map_base.has_value() == has_base), "a pose at the first place");
  expect(code_of(answer.decision.why).has_value() == !is_localized, "a reason of the others");
  for (std::size_t i = 0; i < answer.places.size(); ++i) {
    const AnsweredPlace& one = answer.places[i];
    expect(one.share >= 0 && one.share <= 1, "a share");
    expect(i == 0 || answer.places[i - 1].pose->support >= one.pose->support, "best first");
  }
}

void climb_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.1 : 0;
  const RandomMap tables(random, wrong);
  const bool in_time = random.chance(0.3);
  const auto count = static_cast<std::size_t>(random.number(2, 120));
  SearchedQuery query{{}, surface(random, count, in_time, 0), surface(random, count / 2, in_time, 0), 1};
  const SurfacePoints thinned{query.dense.at.points.data(), query.dense.normals.data(), query.dense.size()};
  std::vector<QueriedScan> scans;
  for (std::int64_t i = random.number(1, 3); i > 0; --i) {
    const PoseMatrix T_last_scan = i == 1 ? PoseMatrix{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1} : pose(random, 0);
    ViewedScan scan{T_last_scan, {std::vector<std::uint8_t>(kDirections, 1), std::vector<float>(kDirections, 5.0F)}, {}};
    if (in_time) scan.returns = query.dense.at;
    query.scans.push_back(scan);
    scans.push_back({{T_last_scan, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, thinned}, 1.2, {thinned.points, thinned.count}, nullptr});
  }
  Cancellation::Word cancelled{random.chance(0.1) ? kNumber : kNumber - 1};
  std::vector<std::unique_ptr<MapSearch>> made;
  std::vector<MapSearch*> searches;
  for (std::int64_t i = random.number(1, 2); i > 0; --i) {
    Describe describe = by_chance(random, tables.map.places->count, cancelled);
    made.push_back(std::make_unique<MapSearch>(tables.map, query, scans, std::move(describe), options(random, cancelled)));
    searches.push_back(made.back().get());
  }
  StageTimes times;
  const bool is_one_likely = random.chance(0.4);
  std::optional<PoseMatrix> T_base_sensor;
  if (random.chance(0.3)) T_base_sensor = pose(random, 0);
  const bool was_cancelled = cancelled == kNumber;
  try {
    if (random.chance(0.3)) searches.back()->may_fit(0.3, times);
    check(answered(searches, is_one_likely, T_base_sensor, times), T_base_sensor.has_value());
  } catch (const Error& error) {
    expect(error.code() == "query_cancelled" && cancelled == kNumber, "ended because it was cancelled");
    return;
  }
  expect(!was_cancelled, "a cancelled query has no answer");
  if (!is_one_likely) {
    for (const MapSearch* search : searches) check(*search);
  }
  for (const auto& [stage, seconds] : times.seconds()) expect(!stage.empty() && seconds >= 0, "the time of a stage");
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::climb_once(random);
  }
}
