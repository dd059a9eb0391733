#include "firstfix/version/template_search.hpp"

#include "asked_scan.hpp"
#include "poses.hpp"
#include "template_tables.hpp"
#include "version_folder.hpp"

namespace firstfix {

struct TemplateSearch::Opened {
  explicit Opened(const version::VersionFolder& folder) : version(folder.version()), templates(folder) {}

  std::string version;
  version::TemplateTables templates;
};

TemplateSearch::TemplateSearch(const std::string& folder) : opened_(std::make_unique<Opened>(version::VersionFolder(folder))) {}
TemplateSearch::~TemplateSearch() = default;
TemplateSearch::TemplateSearch(TemplateSearch&&) noexcept = default;
TemplateSearch& TemplateSearch::operator=(TemplateSearch&&) noexcept = default;

const std::string& TemplateSearch::version() const { return opened_->version; }

std::vector<SimilarPlace> TemplateSearch::find(const Scan& scan, const PlacesOptions& options) const {
  const version::EngineNumbers& numbers = opened_->templates.numbers;
  const auto prepared = version::prepared(scan, options, numbers);
  if (!prepared) return {};
  const Candidates found = opened_->templates.candidates(*prepared, options.prior, options.max_places.value_or(numbers.candidates));
  std::vector<SimilarPlace> places;
  for (std::size_t i = 0; i < found.templates.size(); ++i) {
    places.push_back({version::product(numbers.T_map_level, found.T_level_sensor[i]), static_cast<double>(found.score[i]), found.templates[i]});
  }
  return places;
}

}  // namespace firstfix
