// What the page knows beyond the browser: the chart library's global, and what a chart's figure carries.
interface Window {
    uPlot: any;
}
