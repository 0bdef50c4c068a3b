% Draws measured and simulated moments of held-out trials.
%
%   plot_results(FOLDER, FIGURE)
%
% FOLDER: a participant's folder of carpus compare or carpus personalize; FIGURE: the file of the figure (.png).
% Returns the number of trials drawn, and the mean NRMSE of each model over them.
function [count, nrmse] = plot_results(folder, file)
  results = jsondecode(fileread(fullfile(folder, 'results.json')));
  if ~strcmp(results.schema, 'carpus.results/1')
    error('expected carpus.results/1, found %s', results.schema);
  end
  trials = results.trials;
  if ~iscell(trials)
    trials = num2cell(trials);
  end
  held_out = trials(cellfun(@(t) strcmp(t.use, 'held_out'), trials));
  count = numel(held_out);
  models = fieldnames(held_out{1}.series.simulated_n_m);
  nrmse = zeros(1, numel(models));
  columns = 3;
  figure('visible', 'off', 'paperposition', [0 0 12 2.6 * ceil(count / columns)]);
  for i = 1:count
    trial = held_out{i};
    subplot(ceil(count / columns), columns, i);
    plot(trial.series.time_s, trial.series.measured_n_m, 'color', [0.6 0.6 0.6], 'linewidth', 3);
    hold on;
    for k = 1:numel(models)
      plot(trial.series.time_s, trial.series.simulated_n_m.(models{k}));
      nrmse(k) = nrmse(k) + trial.errors.(models{k}).nrmse / count;
    end
    title(strrep(trial.id, '_', ' '));
    xlabel('time [s]');
    ylabel('moment [N m]');
  end
  legend([{'measured'}; models]);
  print(file, '-dpng', '-r80');
end
